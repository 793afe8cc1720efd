"""What the command line can be asked, a file per group of verbs."""
