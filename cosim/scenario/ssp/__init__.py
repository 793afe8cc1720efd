"""SSP: a scenario as an archive that other tools load, and theirs as a scenario."""
