"""The scenarios of the package, by name; this is known before anything of a scenario is loaded."""

from __future__ import annotations

from importlib.resources import files


def builtin_names() -> list[str]:
    """Return the names of the built-in scenarios.

        >>> from cosim.scenario import builtin_names
        >>> "auv-acoustic" in builtin_names()
        True

    `cosim.run` and `Scenario.load` take them; `cosim scenario show NAME` prints one.
    """
    names = [p.name for p in files("cosim.scenario").joinpath("library").iterdir()]
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))
