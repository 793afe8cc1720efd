"""A link as a component, for tools that do not have this project's links."""
