"""The right-hand side of Eq. (7) over scalars, with any number of delays and uncertainty.

    x' = (A + dA) x(t) + sum_i (Ai + dAi) x(t-d_i) + B u + C w
    z  = D x + D1 w + D2 u
    [dA dA1 ... dAN] = E F(t) [H H1 ... HN]

with the scalar F.amplitude sin(F.omega t) of section 5 on the main diagonal of F(t), which
has as many rows as E has columns and as many columns as H has rows.
Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.models.products import Matrix, product, total


def linear_derivatives(
    t: Any,
    x: Sequence[Any],
    delayed: Sequence[Sequence[Any]],
    u: Sequence[Any],
    w: Sequence[Any],
    m: Mapping[str, Matrix],
    uncertainty: tuple[Any, Any] | None,
    ns: Any,
) -> list[Any]:
    """Return x' of Eq. (7), length n.

    Parameters
    ----------
    t, x : time [s] and x(t), length n.
    delayed : [x(t-d_1), ..., x(t-d_N)], length n each.
    u, w : control (m,) and disturbance (q,).
    m : the matrices by name: A, A1, ..., AN, B, C; with an uncertainty E, H, H1, ..., HN.
    uncertainty : amplitude and angular frequency [rad/s] of F(t); None where there is none.
    ns : namespace with `sin`.
    """
    delays = range(1, len(delayed) + 1)
    terms = [
        product(m["A"], x),
        *(product(m[f"A{i}"], x_of_delay) for i, x_of_delay in zip(delays, delayed, strict=True)),
        product(m["B"], u),
        product(m["C"], w),
    ]
    if uncertainty is not None:
        amplitude, omega = uncertainty
        f = amplitude * ns.sin(omega * t)
        seen = [
            product(m["H"], x),
            *(
                product(m[f"H{i}"], x_of_delay)
                for i, x_of_delay in zip(delays, delayed, strict=True)
            ),
        ]
        inner = [f * total(parts) for parts in zip(*seen, strict=True)]
        # F(t) is rectangular: all entries outside its main diagonal are zero
        common = min(len(inner), len(m["E"][0]))
        terms.append(product([row[:common] for row in m["E"]], inner[:common]))
    return [total(parts) for parts in zip(*terms, strict=True)]


def linear_output(
    x: Sequence[Any], u: Sequence[Any], w: Sequence[Any], m: Mapping[str, Matrix]
) -> list[Any]:
    """Return z = D x + D1 w + D2 u of Eq. (7), length p."""
    terms = (product(m["D"], x), product(m["D1"], w), product(m["D2"], u))
    return [a + b + c for a, b, c in zip(*terms, strict=True)]
