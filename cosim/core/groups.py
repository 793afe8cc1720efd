"""Groups of signals by their names: `eta` has `eta.x`, `x` has `x[1]`."""

from __future__ import annotations


def is_inside(name: str, group: str) -> bool:
    """Whether a signal is one of a group, and not of its name itself."""
    return name.startswith((f"{group}.", f"{group}["))
