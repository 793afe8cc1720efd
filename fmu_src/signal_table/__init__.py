"""Signals from a table as a component, to drive inputs in tools without scenarios."""
