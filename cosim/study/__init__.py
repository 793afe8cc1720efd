"""Studies: thousands of runs of one scenario, each with other values; on one core or on many."""
