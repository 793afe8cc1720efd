"""Distances between values, and the tolerances for them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, is_inside

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A tolerance: values agree if |a - b| <= max(absolute, relative max(|a|, |b|)).

    That is `math.isclose`, but NaN agrees with NaN.

    Raises
    ------
    InputError : a tolerance is negative or not finite.
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
    """A general tolerance, and special ones by signal.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import Tolerances, diff
        >>> from cosim.trace.comparison import Tolerance
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> faster = lag.set("components.lag.parameters.A[1,1]", -1.001)
        >>> runs = run(lag, "lag.mcap"), run(faster, "faster.mcap")
        >>> small = Tolerances(Tolerance(relative=1e-9), {"lag.x": Tolerance(absolute=0.01)})
        >>> diff("lag.mcap", "faster.mcap").equal, diff("lag.mcap", "faster.mcap", small).equal
        (False, True)

    Attributes
    ----------
    special : by the name of a signal (`plant.eta.x`) or of a group (`plant.eta`).
    """

    general: Tolerance = Tolerance()
    special: Mapping[str, Tolerance] = field(default_factory=dict)

    def of(self, name: str) -> Tolerance:
        """Return the tolerance of a signal: the special one of the longest name that fits."""
        fitting = [key for key in self.special if _covers(key, name)]
        return self.special[max(fitting, key=len)] if fitting else self.general

    def check(self, names: list[str]) -> None:
        """Raise an `InputError` if a special tolerance fits none of the names."""
        for key in self.special:
            if not any(_covers(key, name) for name in names):
                raise InputError.unknown("signal", key, names, where="`signal`")


def _covers(key: str, name: str) -> bool:
    return name == key or is_inside(name, key)


def distances(a: NDArray[Any], b: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return |a - b| and |a - b| / max(|a|, |b|), elementwise; two NaN have distance 0.

    a, b : of any kind; values that are no numbers have distance 0 if equal, else infinity.
    """
    if a.dtype.kind not in "fiub" or b.dtype.kind not in "fiub":
        unlike = np.array([x != y for x, y in zip(a, b, strict=True)], np.bool_)
        both = np.where(unlike, np.inf, 0.0)
        return both, both
    with np.errstate(all="ignore"):
        x, y = a.astype(np.float64), b.astype(np.float64)
        alike = (x == y) | (np.isnan(x) & np.isnan(y))
        distance = np.abs(x - y)
        if a.dtype.kind == b.dtype.kind == "i":  # as doubles, large integers may look equal
            alike = a == b
            distance = np.where(alike | (distance > 0), distance, np.abs(a - b))
        distance[np.isnan(distance)] = np.inf
        relative = distance / np.maximum(np.abs(x), np.abs(y))
        relative[np.isnan(relative)] = np.inf
    distance[alike] = relative[alike] = 0.0
    return distance, relative


def exceeds(tolerance: Tolerance, distance: Floats, relative: Floats) -> NDArray[np.bool_]:
    """Return where the distances are beyond the tolerance."""
    return (distance > tolerance.absolute) & (relative > tolerance.relative)
