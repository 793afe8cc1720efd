"""The irregular sea as a component."""
