"""State feedback with an output map and limits, Eq. (8): u = K (x - x_ref), and its integrals.

The output of the controller is `output_map` applied to u, each entry clamped to its limit.
For the vehicle the map is the mass matrix M (u is an acceleration, Eq. (4), and the force is
M u); for a system of the form of Eq. (7) it is the identity and there are no limits.
An integral xi of S (x - x_ref) is further state, u = K (x - x_ref) + K_i xi. Where the output is
at a limit, back-calculation keeps xi from growing on: it integrates G (limited - unlimited) as
well, which is zero inside the limits, where the loop is the linear one of the certificate.
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
    integrals: Sequence[Any] = (),
) -> list[Any]:
    """Return the unlimited output (m,), with x (n,).

    It is output_map @ K @ (x - reference, integrals).
    """
    error = [a - b for a, b in zip(x, reference, strict=True)]
    u = product(K, [*error, *integrals])
    return u if output_map is None else product(output_map, u)


def integrals_after(
    integrals: Sequence[Any],
    error: Sequence[Any],
    S: Sequence[Sequence[Any]],
    back: Sequence[Sequence[Any]],
    excess: Sequence[Any],
    elapsed: Any,
) -> list[Any]:
    """Return integrals + elapsed (S error + back excess).

    S is (k, n), back (k, m), excess (m,) what the limits take off the output, `elapsed` the time
    [s] for which the measurement is held.
    """
    rates = [a + b for a, b in zip(product(S, error), product(back, excess), strict=True)]
    return [xi + elapsed * rate for xi, rate in zip(integrals, rates, strict=True)]


def clamped_command(values: Sequence[Any], limits: Sequence[Any], ns: Any = builtins) -> list[Any]:
    """Clamp each value to +- its limit; `ns` provides `min` and `max` of two."""
    return [ns.max(-bound, ns.min(bound, v)) for v, bound in zip(values, limits, strict=True)]
