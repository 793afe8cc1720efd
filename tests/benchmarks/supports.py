"""Analysis of a vehicle with its observer: on the support of each delay, and about the whole state.

Positions and angles come at any age up to 1.5 and .3 s, the velocities are estimated, the command
acts .3 s late; all states are coupled. 16 states: four axes; 20: with the lags of four actuators;
24: six axes. Unknowns, CPU seconds and gamma of one solve for the least gamma at order 0,
and of a whole analysis, proof included. About the whole state it is Theorem 1, which was all that
such a system had; it is solved where it takes less than some minutes.

Prints a table and JSON (--json: JSON alone).
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from rich.table import Table

from cosim.hinf import Delay, DelaySystem, analyse
from cosim.hinf.certificate import standalone
from cosim.hinf.lmi import Condition
from cosim.hinf.theorems import supports_of
from tests.benchmarks._cpu import cpu_s
from tests.benchmarks._show import show

WHOLE_UP_TO = 16
"""States up to which Theorem 1 is solved as well."""


def pair(axes: int, lags: int = 0, seed: int = 0) -> tuple[DelaySystem, Any]:
    """Return x = (eta, nu, thrusts) with e = (eta, nu) - estimate, and the gain of u."""
    rng, k, n = np.random.default_rng(seed), axes, 2 * axes
    one, zero = np.eye(k), np.zeros((k, k))
    plant = np.block([[zero, one], [zero, -0.1 * one]])
    plant[:k, k:] += 0.1 * rng.standard_normal((k, k))
    plant[k:] += np.hstack([0.004, 0.02])[[0] * k + [1] * k] * rng.standard_normal((k, n))
    x, size = n + lags, 2 * n + lags
    A, B, K = np.zeros((size, size)), np.zeros((size, k)), np.zeros((k, size))
    A[:n, :n], A[x:, x:] = plant, plant
    A[k:n, n:x], A[n:x, n:x] = one[:, :lags], -2.0 * np.eye(lags)
    B[n:x], B[k + lags : n] = 2.0 * one[:lags], one[lags:]
    K[:, :n] = np.hstack([-0.06 * one, -0.53 * one])
    K[:, x:] = -K[:, :n]
    delays = []
    for d, first, last, L in ((1.5, 0, k // 2, (0.5, 0.06)), (0.3, k // 2, k, (0.8, 0.2))):
        late = np.zeros((size, size))
        for i in range(first, last):
            late[x + i, x + i], late[x + k + i, x + i] = -L[0], -L[1]
        delays.append(Delay(d, late, any_age=True))
    delays.append(Delay(0.3, np.zeros((size, size)), feedback=True, any_age=True))
    C, E = np.zeros((size, n)), np.zeros((size, k))
    C[k:n, :k], C[x + k :, :k], C[x : x + k, k:] = one, one, -0.5 * one
    E[k:n], E[x + k :] = 0.02 * one, 0.02 * one
    D, H = np.zeros((n, size)), np.zeros((k, size))
    D[:k, :k], H[:, k:n] = 0.1 * one, one
    return DelaySystem(A, B, C, D, None, np.vstack([zero, one]), E, H, delays), K


def solved(system: DelaySystem, K: Any, supports: Any) -> dict[str, Any]:
    """Return what one solve for the least gamma takes at order 0; `supports` None: Theorem 1."""
    before, delays = cpu_s(), [x.d for x in system.delays]
    lmi: Condition
    if supports is None:
        lmi = Condition(system, K, 0, performance=True)
    else:
        lmi = Condition(system, K, 0, ["interval"] * 3, performance=True, supports=supports)
    least = lmi.least_gamma(delays, 8.0)
    return {
        "unknowns": lmi.unknowns(delays),
        "least_gamma": least,
        "cpu_s": cpu_s() - before,
    }


def row_of(axes: int, lags: int) -> dict[str, Any]:
    """Return the figures of one pair."""
    system, K = pair(axes, lags)
    before = cpu_s()
    found = analyse(system, K)
    seconds = cpu_s() - before
    standalone.check(json.dumps(found.certificate).encode())
    row = {
        "states": len(system.A),
        "gamma": found.gamma,
        "exact_norm": found.exact_norm,
        "analysis_cpu_s": seconds,
        "controls": solved(system, K, supports_of(system, K, controls=True)),
        "states_only": solved(system, K, supports_of(system, K)),
    }
    if len(system.A) <= WHOLE_UP_TO:
        row["whole"] = solved(system, K, None)
        row["times_faster"] = row["whole"]["cpu_s"] / row["controls"]["cpu_s"]
    return row


def main() -> None:
    """Measure and print."""
    rows = [row_of(4, 0), row_of(4, 4), row_of(6, 0)]
    table = Table(title="A vehicle with its observer: unknowns, CPU s, least gamma")
    names = (
        "states",
        "gamma / norm",
        "analysis CPU s",
        "on controls",
        "on states",
        "Theorem 1",
        "ratio",
    )
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        each = [row.get(key) for key in ("controls", "states_only", "whole")]
        table.add_row(
            str(row["states"]),
            f"{row['gamma']:.5g} / {row['exact_norm']:.5g}",
            f"{row['analysis_cpu_s']:.1f}",
            *(
                f"{x['unknowns']}, {x['cpu_s']:.1f} s, {x['least_gamma']:.5g}" if x else "-"
                for x in each
            ),
            f"{row['times_faster']:.0f}" if "times_faster" in row else "-",
        )
    show(table, {"rows": rows})


if __name__ == "__main__":
    main()
