"""The documentation page's notes on an observer: its dimensions, measurements and commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def notes(data: Mapping[str, Any], ages: Mapping[str, float], constants: Mapping[str, Any]) -> str:
    """Return what is particular of an FMU as Markdown.

    Parameters
    ----------
    data : its certificate.
    ages : greatest age per measurement [s].
    constants : those of its behaviour.
    """
    n, m = len(data["plant"]["A"]), len(data["plant"]["B"][0])
    commands = constants["commands"]
    own = f"{n} state{_s(n)}, {m} control{_s(m)}"
    if commands:
        bounds = "limited to ± `limit.`" if constants["with_limits"] else "without limits"
        own += f", {len(commands)} command{_s(len(commands))}, {bounds}"
    else:
        own += "; the control that acts is an input"
    lines = ["", "## This one", "", f"{own}.", "", "| measurement | values | greatest age |"]
    lines += ["|---|---|---|"]
    for one in data["measurements"]:
        name = one["name"]
        lines.append(f"| `{name}` | {len(one['C'])} | {ages[name]:g} s |")
    return "\n".join([*lines, ""])


def _s(count: int) -> str:
    return "" if count == 1 else "s"
