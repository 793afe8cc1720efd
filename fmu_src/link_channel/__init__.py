"""A link as a component: what other tools step in place of the project's own links."""
