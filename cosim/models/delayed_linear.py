"""Eq. (7) over plain scalars, its uncertainty included.

    x' = (A + dA) x(t) + (A1 + dA1) x(t-d) + B u + C w,   [dA dA1] = E F(t) [H H1]
    z  = D x + D1 w + D2 u

with the scalar F(t) = F.amplitude sin(F.omega t) of section 5 (times the identity).
Standard library only: this file also travels inside the FMU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.models.products import Matrix, product, total


def derivatives(
    t: Any,
    x: Sequence[Any],
    delayed: Sequence[Any],
    u: Sequence[Any],
    w: Sequence[Any],
    m: Mapping[str, Matrix],
    uncertainty: tuple[Any, Any],
    ns: Any,
) -> list[Any]:
    """x' of Eq. (7), length n.

    Parameters
    ----------
    t, x, delayed : time [s], x(t) and x(t-d), length n.
    u, w : control (m,) and disturbance (q,).
    m : the matrices by their letters: A, A1, B, C, E, H, H1.
    uncertainty : amplitude and angular frequency [rad/s] of F(t).
    ns : namespace with `sin`.
    """
    amplitude, omega = uncertainty
    f = amplitude * ns.sin(omega * t)
    inner = [
        f * (a + b) for a, b in zip(product(m["H"], x), product(m["H1"], delayed), strict=True)
    ]
    terms = (
        product(m["A"], x),
        product(m["A1"], delayed),
        product(m["B"], u),
        product(m["C"], w),
        product(m["E"], inner),
    )
    return [total(parts) for parts in zip(*terms, strict=True)]


def output(
    x: Sequence[Any], u: Sequence[Any], w: Sequence[Any], m: Mapping[str, Matrix]
) -> list[Any]:
    """z = D x + D1 w + D2 u of Eq. (7), length p."""
    return [
        a + b + c
        for a, b, c in zip(
            product(m["D"], x), product(m["D1"], w), product(m["D2"], u), strict=True
        )
    ]
