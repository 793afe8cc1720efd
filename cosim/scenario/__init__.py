"""Scripted scenarios: read, assemble, fly, judge."""
