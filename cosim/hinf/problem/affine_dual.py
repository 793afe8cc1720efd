"""Dual numbers of affine forms: equations written for scalars, and their derivative over a box.

An `AffineDual` has a value and the derivative along one variable. `AFFINE` is the namespace for
equations that take `sin`, `cos`, ... from one.

The derivative of v |v| is 2 |v|, also where v changes sign. The product rule alone would lose that:
v sign(v) with sign(v) in [-1, 1] is not known to be |v|. An absolute value therefore keeps what it
is of, and a product with that is differentiated as one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import flint
import numpy as np

from cosim.hinf.problem.affine_form import AffineForm, cosine, reciprocal, rising
from cosim.hinf.problem.coupled_drag import drag_and_slopes

_ONE = AffineForm(1.0)


class AffineDual:
    """The value and the derivative of an expression over pieces of a box.

    Parameters
    ----------
    value : its form.
    slope : that of the derivative along one variable; None: exactly zero.
    of : where the expression is c |x|: x and c, whose derivative is zero.
    """

    __slots__ = ("of", "slope", "value")

    def __init__(
        self,
        value: AffineForm,
        slope: AffineForm | None = None,
        of: tuple[AffineDual, AffineForm] | None = None,
    ) -> None:
        self.value, self.slope, self.of = value, slope, of

    def __neg__(self) -> AffineDual:
        slope = None if self.slope is None else -self.slope
        of = None if self.of is None else (self.of[0], -self.of[1])
        return AffineDual(-self.value, slope, of)

    def __pos__(self) -> AffineDual:
        return self

    def __add__(self, other: Any) -> AffineDual:
        b = dual(other)
        return AffineDual(self.value + b.value, _sum(self.slope, b.slope))

    __radd__ = __add__

    def __sub__(self, other: Any) -> AffineDual:
        return self + (-dual(other))

    def __rsub__(self, other: Any) -> AffineDual:
        return (-self).__add__(other)

    def __mul__(self, other: Any) -> AffineDual:
        b = dual(other)
        if b is self:
            return AffineDual(self.value.square(), _times(self.slope, self.value + self.value))
        of = None
        for one, two in ((self, b), (b, self)):
            if one.of is None:
                continue
            x, c = one.of
            if x is two:
                size = two.value.magnitude()[0]
                return AffineDual(one.value * two.value, _times(two.slope, c * (size + size)))
            if two.slope is None:
                of = x, c * two.value
        slope = _sum(_times(self.slope, b.value), _times(b.slope, self.value))
        return AffineDual(self.value * b.value, slope, of)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> AffineDual:
        b = dual(other)
        if b.slope is None and not b.value.parts and not b.value.rest.any():
            return self * (1.0 / b.value.middle)
        one = b.value.through(reciprocal)
        return self * AffineDual(one, _times(b.slope, -(one.square())))

    def __rtruediv__(self, other: Any) -> AffineDual:
        return dual(other) / self

    def __pow__(self, power: int) -> AffineDual:
        if power != int(power) or power < 1:
            raise ValueError(f"expected a whole power >= 1, got {power!r}")
        result = self
        for _ in range(int(power) - 1):
            result = self * result
        return result

    def __abs__(self) -> AffineDual:
        size, sign = self.value.magnitude()
        return AffineDual(size, _times(self.slope, sign), (self, _ONE))


def dual(value: Any) -> AffineDual:
    """Return a number, or a form, as a constant; a dual as it is."""
    if isinstance(value, AffineDual):
        return value
    return AffineDual(value if isinstance(value, AffineForm) else AffineForm(value))


def _sum(a: AffineForm | None, b: AffineForm | None) -> AffineForm | None:
    return b if a is None else a if b is None else a + b


def _times(slope: AffineForm | None, factor: AffineForm) -> AffineForm | None:
    return None if slope is None else slope * factor


def _function(
    value: Callable[[Any, Any], tuple[Any, Any]],
    slope: Callable[[AffineForm, AffineForm], AffineForm],
) -> Callable[[Any], AffineDual]:
    """Make a function of duals from its enclosure and its derivative at x with value y."""

    def function(x: Any) -> AffineDual:
        x = dual(x)
        y = x.value.through(value)
        return AffineDual(y, None if x.slope is None else x.slope * slope(x.value, y))

    return function


def _sine(a: Any, b: Any) -> tuple[Any, Any]:
    return cosine(a, b, flint.arb.pi() / 2)


def _larger(a: Any, b: Any) -> AffineDual:
    """Return the larger of two; where either may be, what lies between the two."""
    a, b = dual(a), dual(b)
    (p, q), (r, s) = a.value.bounds, b.value.bounds
    first, second = p >= s, r >= q

    def chosen(x: AffineForm, y: AffineForm, least: Any, most: Any) -> AffineForm:
        open_ = ~(first | second)
        blank = np.where(open_, 0.0, 1.0)
        between = AffineForm.between(np.where(open_, least, 0.0), np.where(open_, most, 0.0))
        one, two = (AffineForm(np.where(mask, 1.0, 0.0)) for mask in (first, second & ~first))
        return between * AffineForm(1 - blank) + x * one + y * two

    value = chosen(a.value, b.value, np.maximum(p, r), np.maximum(q, s))
    if a.slope is None and b.slope is None:
        return AffineDual(value)
    x, y = a.slope or AffineForm(0.0), b.slope or AffineForm(0.0)
    ends = x.bounds, y.bounds
    least = np.minimum(ends[0][0], ends[1][0])
    return AffineDual(value, chosen(x, y, least, np.maximum(ends[0][1], ends[1][1])))


_atan = _function(rising("atan"), lambda x, _: (_ONE + x.square()).through(reciprocal))


def _atan2(y: Any, x: Any) -> AffineDual:
    """Return the angle of (x, y) where x > 0; not a number elsewhere."""
    x = dual(x)
    right = np.where(x.value.bounds[0] > 0, 1.0, math.nan)
    return _atan(dual(y) / x * right)


def _coupled_drag(
    v: Any, w: Any, sway: float, heave: float, softening: float
) -> tuple[AffineDual, AffineDual]:
    """Return the drag across a hull of `cosim.models`, where the flow may be zero as well."""
    v, w = dual(v), dual(w)
    values, slopes = drag_and_slopes(v.value, w.value, sway, heave, softening)
    along, down = (
        AffineDual(value, _sum(_times(v.slope, by_v), _times(w.slope, by_w)))
        for value, (by_v, by_w) in zip(values, slopes, strict=True)
    )
    return along, down


AFFINE = SimpleNamespace(
    sin=_function(_sine, lambda x, _: x.through(cosine)),
    cos=_function(cosine, lambda x, _: -x.through(_sine)),
    asin=_function(
        rising("asin", -1.0, 1.0),
        lambda x, _: (_ONE + -x.square()).through(rising("sqrt", 0.0)).through(reciprocal),
    ),
    atan2=_atan2,
    sqrt=_function(rising("sqrt", 0.0), lambda _, y: (y + y).through(reciprocal)),
    exp=_function(rising("exp"), lambda _, y: y),
    max=_larger,
    min=lambda a, b: -_larger(-dual(a), -dual(b)),
    coupled_drag=_coupled_drag,
)
"""The functions of equations, for `AffineDual`."""
