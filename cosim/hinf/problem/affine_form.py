"""Affine forms: values over a box that remember which variable they vary with.

A form is c + sum_k a_k e_k + r [-1, 1], one |e_k| <= 1 per symbol: a variable of the box, or what
an operation that is not affine leaves unknown. Where a variable occurs twice, as in
(-m + Y_ur) r, its parts cancel, as they do not in interval arithmetic. Rounding goes into r, so a
form encloses the exact value; functions are enclosed by balls of python-flint. c, a_k and r are
arrays with one entry per piece of the box. (Stolfi, de Figueiredo, Self-Validated Numerical
Methods and Applications, 1997.)
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any

import flint
import numpy as np
from numpy.typing import NDArray

Bounds = NDArray[np.float64]

_ROUNDING = 2.0**-52
new_symbol = itertools.count(1).__next__
"""Return a number that no symbol has yet."""


class AffineForm:
    """A form; not a number where an operation is not defined over the box.

    Parameters
    ----------
    middle : c.
    parts : a_k by symbol.
    rest : r >= 0.
    """

    __slots__ = ("middle", "parts", "rest")

    def __init__(
        self, middle: Any, parts: Mapping[int, Any] | None = None, rest: Any = 0.0
    ) -> None:
        self.middle = np.asarray(middle, dtype=np.float64)
        self.parts = dict(parts or {})
        self.rest = np.asarray(rest, dtype=np.float64)

    @classmethod
    def between(cls, lower: Any, upper: Any) -> AffineForm:
        """Return the form, with a symbol of its own, of what lies between two bounds."""
        middle = lower / 2 + upper / 2
        size = np.maximum(upper - middle, middle - lower)
        made = AffineForm(middle, {new_symbol(): size})
        return made.rounded()

    @property
    def radius(self) -> Bounds:
        """The largest deviation from the middle."""
        total = sum((np.abs(a) for a in self.parts.values()), self.rest)
        return np.asarray(total * (1 + _ROUNDING * (len(self.parts) + 2)))

    @property
    def bounds(self) -> tuple[Bounds, Bounds]:
        """The least and the greatest value."""
        radius = self.radius
        lower, upper = self.middle - radius, self.middle + radius
        certain = radius == 0
        return (
            np.where(certain, lower, np.nextafter(lower, -math.inf)),
            np.where(certain, upper, np.nextafter(upper, math.inf)),
        )

    def __neg__(self) -> AffineForm:
        return AffineForm(-self.middle, {k: -a for k, a in self.parts.items()}, self.rest)

    def __add__(self, other: AffineForm) -> AffineForm:
        parts = dict(self.parts)
        for k, a in other.parts.items():
            parts[k] = parts[k] + a if k in parts else a
        return AffineForm(self.middle + other.middle, parts, self.rest + other.rest).rounded()

    def __mul__(self, other: AffineForm) -> AffineForm:
        if self is other:
            return self.square()
        if not self.parts and not self.rest.any():
            self, other = other, self  # noqa: PLW0642 - a factor that is certain comes second
        if not other.parts and not other.rest.any():
            parts = {k: a * other.middle for k, a in self.parts.items()}
            scaled = AffineForm(self.middle * other.middle, parts, self.rest * np.abs(other.middle))
            return scaled.rounded()
        parts = {k: a * other.middle for k, a in self.parts.items()}
        for k, a in other.parts.items():
            parts[k] = parts.get(k, 0.0) + a * self.middle
        rest = np.abs(self.middle) * other.rest + np.abs(other.middle) * self.rest
        rest = rest + self.radius * other.radius
        return AffineForm(self.middle * other.middle, parts, rest).rounded()

    def square(self) -> AffineForm:
        """Return x^2: the square of the deviation is not negative."""
        half = self.radius**2 / 2
        parts = {k: 2 * self.middle * a for k, a in self.parts.items()}
        rest = 2 * np.abs(self.middle) * self.rest + half
        return AffineForm(self.middle**2 + half, parts, rest).rounded()

    def magnitude(self) -> tuple[AffineForm, AffineForm]:
        """Return |x| and the sign of x, between -1 and 1 where x may be either."""
        lower, upper = self.bounds
        sign = np.where(lower >= 0, 1.0, np.where(upper <= 0, -1.0, 0.0))
        open_ = np.where(np.isnan(lower), math.nan, np.where(sign == 0, 1.0, 0.0))
        half = open_ * np.maximum(-lower, upper) / 2
        k = new_symbol()
        parts = {j: sign * a for j, a in self.parts.items()} | {k: half}
        size = AffineForm(sign * self.middle + half, parts, np.abs(sign) * self.rest)
        return size.rounded(), AffineForm(sign, {new_symbol(): open_})

    def through(self, function: Callable[[Any, Any], tuple[Any, Any]]) -> AffineForm:
        """Return a function's values: from balls of the ends of x to balls of its extremes."""
        ends = np.stack([np.ravel(end) for end in np.broadcast_arrays(*self.bounds)])
        pairs, places = np.unique(ends, axis=1, return_inverse=True)
        extremes = np.full(pairs.shape, math.nan)
        for k, (a, b) in enumerate(pairs.T):
            if math.isfinite(a) and math.isfinite(b):
                low, high = function(flint.arb(a), flint.arb(b))
                extremes[:, k] = float(low.lower()), float(high.upper())
        low, high = extremes[:, places.ravel()].reshape(2, *np.shape(self.bounds[0]))
        return AffineForm.between(np.nextafter(low, -math.inf), np.nextafter(high, math.inf))

    def rounded(self) -> AffineForm:
        """Add what the last operation may have rounded; one of zeros and nothing else is exact."""
        size = np.abs(self.middle) + self.radius
        self.rest = self.rest + size * (_ROUNDING * (len(self.parts) + 8))
        return self


def cosine(a: Any, b: Any, shift: Any = 0) -> tuple[Any, Any]:
    """Enclose cos(x - shift) for a <= x <= b: its ends, and -1 or 1 where that may lie between."""
    a, b, pi = a - shift, b - shift, flint.arb.pi()
    if not b - a < 2 * pi:
        return flint.arb(-1), flint.arb(1)
    low, high = a.cos().min(b.cos()), a.cos().max(b.cos())
    first, last = float((a / pi).lower()), float((b / pi).upper())
    for k in range(math.floor(first), math.ceil(last) + 1):
        if not (k * pi < a or k * pi > b):
            low, high = (low, flint.arb(1)) if k % 2 == 0 else (flint.arb(-1), high)
    return low, high


def rising(
    name: str, least: float = -math.inf, most: float = math.inf
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Enclose a function that rises on [least, most] and is not defined elsewhere."""

    def enclose(a: Any, b: Any) -> tuple[Any, Any]:
        if not (a >= least and b <= most):
            return flint.arb.nan(), flint.arb.nan()
        return getattr(a, name)(), getattr(b, name)()

    return enclose


def reciprocal(a: Any, b: Any) -> tuple[Any, Any]:
    """Enclose 1/x, which is not defined where the interval contains zero."""
    if not (a > 0 or b < 0):
        return flint.arb.nan(), flint.arb.nan()
    return 1 / b, 1 / a
