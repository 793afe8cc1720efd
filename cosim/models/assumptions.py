"""The use of an assumption: the share of what a guarantee allows, at present and at most so far.

A guarantee holds while ages, the envelope and the limits of commands are used by no more than 1.
Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from typing import Any


def greatest_share(values: Sequence[Any], bounds: Sequence[Any], ns: Any) -> Any:
    """Return the greatest |value| / bound; 0 without any. `ns` provides `max` of two."""
    greatest: Any = 0.0
    for value, bound in zip(values, bounds, strict=True):
        greatest = ns.max(greatest, abs(value) / bound)
    return greatest


def share_of_age(age: float, most: float, now: float) -> tuple[float, bool]:
    """Return the share of the greatest age that an age is, and whether it is beyond it.

    An age that is beyond only by rounding is not; `now` is the time, which may drift by it.
    """
    share, beyond = age / most, age > most + 1e-9 * max(1.0, abs(now))
    return share if beyond else min(share, 1.0), beyond


def watch(v: MutableMapping[str, float], uses: Sequence[str]) -> None:
    """Write `assumption.USE`, the greatest `present.USE` so far, and `assumption.met`."""
    for use in uses:
        v[f"assumption.{use}"] = max(v[f"assumption.{use}"], v[f"present.{use}"])
    v["assumption.met"] = int(all(v[f"assumption.{use}"] <= 1.0 for use in uses))
