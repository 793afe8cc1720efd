"""Which parameters of a run are not those of its design, in words, from its metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_NAMED = 3
"""Parameters that are named one by one."""


def plant_line(metrics: Mapping[str, Any]) -> str:
    """Return which parameters are not those of the design, the first ones with both values."""
    found = metrics.get("plant_differences") or ()
    if not found:
        return "the plant of the run has other parameters than the design's model"
    words = [
        f"{x['parameter']} is {'absent' if x['value'] is None else format(x['value'], '.6g')}, "
        f"designed for {x['designed']:.6g}"
        for x in found[:_NAMED]
    ]
    more = [f"and {len(found) - _NAMED} more"] if len(found) > _NAMED else []
    return "; ".join([*words, *more])
