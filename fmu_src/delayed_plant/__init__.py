"""A linear delay system, Eq. (7) with any matrices, as a component."""
