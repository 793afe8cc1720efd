"""Parts of the documentation page inside an FMU: text with equations, snippets, variables."""
