"""A vehicle of a vehicle file as a component."""
