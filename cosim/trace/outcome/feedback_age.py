"""The ages that the guarantee of a run assumes, in words, from the metrics of its result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_ASSUMED = "age of the feedback, assumed: "


def age_lines(age: Mapping[str, Any]) -> list[str]:
    """Return which ages of the feedback are assumed, measured, and justified, a sentence each.

    `age` : the metric `feedback_age`; what another version left out is left out here.
    """
    lines = []
    if isinstance(age.get("assumed"), str):
        lines.append(f"{_ASSUMED}{age['assumed']}")
    measured = age.get("measured")
    if isinstance(measured, Mapping):
        least, most = _seconds(measured.get("least_s")), _seconds(measured.get("greatest_s"))
        line = f"in this run: from {least} to {most}"
        if measured.get("least_s") is None:
            line = f"in this run: up to {most}"
        used: Any = measured.get("in_use_s")
        if isinstance(used, list) and len(used) == 2:
            one = used[0] == used[1]
            words = f"always {_seconds(used[0])}" if one else " to ".join(map(_seconds, used))
            line += f", {words} when a measurement comes into use"
        lines.append(line)
    settings = age.get("settings")
    if isinstance(settings, Mapping):
        greatest = settings.get("greatest_s")
        bound = "without a bound" if greatest is None else f"to {_seconds(greatest)}"
        kind = "sampled" if settings.get("sampled") is True else "any age"
        lines.append(
            f"by the settings of the links: {kind} from {_seconds(settings.get('least_s'))} "
            f"{bound}; {settings.get('why')}"
        )
    return lines


def measurement_age_lines(ages: Mapping[str, Any]) -> dict[str, str]:
    """Return by measurement which ages are assumed and measured, and of the commands.

    `ages` : the metric `measurement_ages`.
    """
    found = {}
    for name, age in ages.items():
        if isinstance(age, Mapping):
            lines = age_lines(age)
            found[name] = "; ".join(line.removeprefix(_ASSUMED) for line in lines)
            if not isinstance(age.get("measured"), Mapping):
                found[name] += "; none came into use"
    return found


def _seconds(value: Any) -> str:
    return f"{value:.6g} s" if isinstance(value, int | float) else str(value)
