"""The drag across a hull and its slopes over a box that may contain no flow at all.

F = (S v^2 + T w^2) (v, w) / (h + e) with h = sqrt(v^2 + w^2): smooth but for its second derivative
at zero, where the root and the quotient of its formula have no enclosed slope. With x = (v/h)^2 and
g = h / (h + e),

    dF_v/dv = g h (S x (3 - x) + T (1 - x)^2)        + r,    0 <= r <= e max(S, T)
    dF_v/dw = g (v w / h) (T (1 + x) - S x)          + r,    |r| <= e max(S, T)

and alike for F_w with v and w, S and T exchanged: h times a polynomial of the direction, bounded
wherever the direction may be.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.hinf.problem.affine_form import AffineForm, Bounds

Interval = tuple[Bounds, Bounds]
Forms = tuple[AffineForm, AffineForm]

_OUTWARD = 1e-12
"""Part of a bound that is added to it for rounding: some hundred operations of 1e-16 each."""


def drag_and_slopes(
    v: AffineForm, w: AffineForm, sway: float, heave: float, softening: float
) -> tuple[Forms, tuple[Forms, Forms]]:
    """Return F_v and F_w, and their slopes by v and w.

    sway, heave, softening : S, T >= 0 and e > 0.
    """
    along = _part(v, w, sway, heave, softening)
    down = _part(w, v, heave, sway, softening)
    return (along[0], down[0]), ((along[1], along[2]), (down[2], down[1]))


def _part(
    v: AffineForm, w: AffineForm, linear: float, other: float, softening: float
) -> tuple[AffineForm, AffineForm, AffineForm]:
    """Return F_v, its slope by v and its slope by w."""
    (v_low, v_high), (w_low, w_high) = v.bounds, w.bounds
    v_square, w_square = _square(v_low, v_high), _square(w_low, w_high)
    h = _wider(*(np.sqrt(a + b) for a, b in zip(v_square, w_square, strict=True)))
    g = h[0] / (h[0] + softening), h[1] / (h[1] + softening)
    gh = g[0] * h[0], g[1] * h[1]
    x, y = _shares(v_square, w_square), _shares(w_square, v_square)
    cosine = _signed(np.sqrt(x[0]), np.sqrt(x[1]), v_low, v_high)
    sine = _signed(np.sqrt(y[0]), np.sqrt(y[1]), w_low, w_high)
    squares = v.square() * AffineForm(linear) + w.square() * AffineForm(other)
    value = squares * _form(_product(g, cosine))
    rest = softening * max(linear, other) + _OUTWARD * (linear + other) * h[1]
    by_v = _product(gh, _quadratic(other - linear, 3 * linear - 2 * other, other, x))
    half = _product(cosine, sine)  # of the same angle
    half = np.maximum(half[0], -0.5), np.minimum(half[1], 0.5)
    by_w = _product(_product(gh, half), _quadratic(0.0, other - linear, other, x))
    return value, _form((by_v[0], by_v[1] + rest)), _form((by_w[0] - rest, by_w[1] + rest))


def _square(low: Bounds, high: Bounds) -> Interval:
    """Enclose x^2."""
    ends = low * low, high * high
    return np.where((low < 0) & (high > 0), 0.0, np.minimum(*ends)), np.maximum(*ends)


def _shares(a: Interval, b: Interval) -> Interval:
    """Enclose a / (a + b), which may be anything from 0 to 1 where both are zero."""
    ends = (a[0], b[1], 0.0), (a[1], b[0], 1.0)
    low, high = (np.where(p + q > 0, p / np.where(p + q > 0, p + q, 1.0), r) for p, q, r in ends)
    return low, high


def _signed(least: Bounds, most: Bounds, low: Bounds, high: Bounds) -> Interval:
    """Give an amount within bounds the sign of what lies between low and high."""
    return np.where(low >= 0, least, -most), np.where(high <= 0, -least, most)


def _quadratic(a: float, b: float, c: float, x: Interval) -> Interval:
    """Enclose a x^2 + b x + c."""
    turn = np.clip(-b / (2 * a), *x) if a != 0 else x[0]
    values = [a * at * at + b * at + c for at in (*x, turn)]
    return np.minimum.reduce(values), np.maximum.reduce(values)


def _product(a: Interval, b: Interval) -> Interval:
    ends = [p * q for p in a for q in b]
    return np.minimum.reduce(ends), np.maximum.reduce(ends)


def _wider(low: Any, high: Any) -> Interval:
    return low - _OUTWARD * np.abs(low), high + _OUTWARD * np.abs(high)


def _form(bounds: Interval) -> AffineForm:
    return AffineForm.between(*_wider(*bounds))
