"""What verify checks: the file, the run in it, its links."""
