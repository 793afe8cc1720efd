"""The components that become FMUs: variables, behaviour, and the shells around them."""
