"""Static state feedback with an output map and limits, Eq. (8): u = K (x - x_ref).

The output of the controller is `output_map` applied to u, each entry clamped to its limit.
For the vehicle the map is the mass matrix M (u is an acceleration, Eq. (4), and the force is
M u); for a system of the form of Eq. (7) it is the identity and there are no limits.
Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

import builtins
from collections.abc import Sequence
from typing import Any

from cosim.models.products import product


def feedback_command(
    K: Sequence[Sequence[Any]],
    x: Sequence[Any],
    reference: Sequence[Any],
    output_map: Sequence[Sequence[Any]] | None,
) -> list[Any]:
    """Return the unlimited output (m,): output_map @ K @ (x - reference), with x (n,)."""
    error = [a - b for a, b in zip(x, reference, strict=True)]
    u = product(K, error)
    return u if output_map is None else product(output_map, u)


def clamped_command(values: Sequence[Any], limits: Sequence[Any], ns: Any = builtins) -> list[Any]:
    """Clamp each value to +- its limit; `ns` provides `min` and `max` of two."""
    return [ns.max(-bound, ns.min(bound, v)) for v, bound in zip(values, limits, strict=True)]
