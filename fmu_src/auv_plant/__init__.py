"""The delayed vehicle as a component."""
