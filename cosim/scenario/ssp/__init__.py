"""SSP archives: export a scenario for other tools, import theirs as a scenario."""
