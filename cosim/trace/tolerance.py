"""How far apart two values may be, and how far apart they are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Two values agree if |a - b| <= max(absolute, relative max(|a|, |b|)), as `math.isclose`.

    NaN agrees with NaN, an infinity with itself.

    Raises
    ------
    InputError : negative, or no number.
    """

    absolute: float = 0.0
    relative: float = 0.0

    def __post_init__(self) -> None:
        for name in ("absolute", "relative"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(
                    "not a tolerance",
                    where=f"{name} tolerance",
                    expected="a number from 0 up",
                    got=repr(value),
                )


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of all signals, and others of some.

    Attributes
    ----------
    special : by the name of a signal (`plant.eta.x`), or of a group (`plant.eta`).
    """

    general: Tolerance = Tolerance()
    special: Mapping[str, Tolerance] = field(default_factory=dict)

    def of(self, name: str) -> Tolerance:
        """That of a signal: the longest name that fits."""
        fitting = [key for key in self.special if _covers(key, name)]
        return self.special[max(fitting, key=len)] if fitting else self.general

    def check(self, names: list[str]) -> None:
        """Refuse a special tolerance of something that is not there."""
        for key in self.special:
            if not any(_covers(key, name) for name in names):
                raise InputError.unknown("signal", key, names, where="--signal")


def _covers(key: str, name: str) -> bool:
    return name == key or name.startswith((f"{key}.", f"{key}["))


def distances(a: NDArray[Any], b: NDArray[Any]) -> tuple[Floats, Floats]:
    """|a - b| and |a - b| / max(|a|, |b|), elementwise; of what is no number 0, or inf if unlike.

    a, b : of any kind; two NaN are alike.
    """
    if a.dtype.kind not in "fiub" or b.dtype.kind not in "fiub":
        unlike = np.array([x != y for x, y in zip(a, b, strict=True)], np.bool_)
        both = np.where(unlike, np.inf, 0.0)
        return both, both
    with np.errstate(all="ignore"):
        x, y = a.astype(np.float64), b.astype(np.float64)
        alike = (x == y) | (np.isnan(x) & np.isnan(y))
        distance = np.abs(x - y)
        if a.dtype.kind == b.dtype.kind == "i":  # doubles do not tell large integers apart
            alike = a == b
            distance = np.where(alike | (distance > 0), distance, np.abs(a - b))
        distance[np.isnan(distance)] = np.inf
        relative = distance / np.maximum(np.abs(x), np.abs(y))
        relative[np.isnan(relative)] = np.inf
    distance[alike] = relative[alike] = 0.0
    return distance, relative


def exceeds(tolerance: Tolerance, distance: Floats, relative: Floats) -> NDArray[np.bool_]:
    """Where values are further apart than they may be."""
    return (distance > tolerance.absolute) & (relative > tolerance.relative)
