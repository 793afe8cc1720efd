"""A component whose steps are Python code of the process that flies it."""
