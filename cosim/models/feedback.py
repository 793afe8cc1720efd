"""Static state feedback with an output map and limits, Eq. (8): u = K (x - x_ref).

What leaves the controller is `output_map` applied to u, each entry held within its limit.
For the vehicle the map is the mass matrix M (u is an acceleration, Eq. (4), and force is
M u); for a system in the letters of Eq. (7) it is the identity and there are no limits.
Standard library only: this file also travels inside the FMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def command(
    K: Sequence[Sequence[Any]],
    x: Sequence[Any],
    reference: Sequence[Any],
    output_map: Sequence[Sequence[Any]] | None,
) -> list[Any]:
    """Unlimited output: output_map @ K @ (x - reference), lengths (m,), from x (n,)."""
    error = [a - b for a, b in zip(x, reference, strict=True)]
    u = [sum(k * e for k, e in zip(row, error, strict=True)) for row in K]
    if output_map is None:
        return u
    return [sum(c * v for c, v in zip(row, u, strict=True)) for row in output_map]


def limited(values: Sequence[float], limits: Sequence[float]) -> list[float]:
    """Each value held within +- its limit."""
    return [max(-bound, min(bound, v)) for v, bound in zip(values, limits, strict=True)]
