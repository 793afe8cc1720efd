"""What makes pages of the documentation from the code; `mkdocs build` calls `hooks`."""
