"""Signals given as a table: what drives inputs in tools that have no scenario."""
