"""The vehicle with an internal delay as a component."""
