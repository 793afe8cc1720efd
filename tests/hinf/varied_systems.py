"""Systems of varied shape for designs, from a seed, and chains of masses."""

from __future__ import annotations

import numpy as np

from cosim.models import Delay, DelaySystem

FRIDMAN_SHAKED = DelaySystem(
    [[0, 0], [0, 1]],
    [[0], [1]],
    [[1], [1]],
    [[0, 1], [0, 0]],
    D2=[[0], [0.1]],
    delays=[Delay(0.999, [[-1, -1], [0, -0.9]])],
)
"""Fridman and Shaked 2002, an unstable state behind a delay of 0.999 s."""

NOMOTO_SHIP = DelaySystem(
    [[0, 1], [0, -1 / 40]],
    [[0], [0.05 / 40]],
    [[0], [1 / 40]],
    [[1, 0], [0, 0]],
    D2=[[0], [0.1]],
    delays=[Delay(5.0, np.zeros((2, 2)), feedback=True)],
)
"""T r' + r = K rudder, K = 0.05, T = 40 s, heading and rate, steered over five seconds."""


def chain(n: int, d: float = 0.1) -> DelaySystem:
    """Return n/2 masses between springs, pushed at the last over d, disturbed at the first."""
    m = n // 2
    stiffness = 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-stiffness, -0.1 * np.eye(m)]])
    B, C, D = np.zeros((n, 1)), np.zeros((n, 1)), np.zeros((2, n))
    B[n - 1], C[m], D[0, m - 1] = 1.0, 1.0, 1.0
    delays = [Delay(d, np.zeros((n, n)), feedback=True)]
    return DelaySystem(A, B, C, D, D2=[[0], [0.1]], delays=delays)


def steered_chain(n: int, late: float = 0.1, price: float = 0.3) -> DelaySystem:
    """Return n/2 damped masses, steered at both ends, whose least gamma asks for any gain.

    late : damping that acts over the delay; price : of the control, in z.
    """
    m = n // 2
    rest = np.zeros((m, m))
    stiffness = 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
    A = np.block([[rest, np.eye(m)], [-stiffness, -0.4 * np.eye(m)]])
    A1 = np.block([[rest, rest], [rest, -late * np.eye(m)]])
    B, C, D = np.zeros((n, 2)), np.zeros((n, 1)), np.zeros((3, n))
    B[m, 0] = B[n - 1, 1] = C[m + m // 2] = D[0, m // 2] = 1.0
    D2 = [[0, 0], [price, 0], [0, price]]
    return DelaySystem(A, B, C, D, D2=D2, delays=[Delay(0.3, A1)])


def varied_system(seed: int) -> DelaySystem:
    """Return a system of any shape that a design takes, some at the edge of what any gain can do.

    One to six states, one to three delays of which one may carry the feedback, one or two
    inputs, uncertain or not, delays constant or of any age. Some have a pole on the axis or one
    that is hardly controllable, some count their states or their time in odd units.
    """
    rng = np.random.default_rng([15, seed])
    n, m, count = (int(rng.integers(1, high)) for high in (7, 3, 4))
    rate = float(10 ** rng.uniform(-1.0, 1.0))
    late, uncertain, marginal, weak, odd = rng.random(5) < (0.5, 0.35, 0.2, 0.15, 0.2)
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    A -= (float(np.linalg.eigvals(A).real.max()) - rng.uniform(-1.0, 0.5)) * np.eye(n)
    if marginal:
        A[:, 0] = 0.0  # an integrator
    B = rng.standard_normal((n, m))
    if weak:
        B *= 10 ** rng.uniform(-3.0, 0.0, (n, 1))
    S = 10 ** rng.uniform(-3.0, 3.0, n) if odd else np.ones(n)

    def H() -> np.ndarray | None:
        return 0.1 * rng.standard_normal((1, n)) / S if uncertain else None

    def lengths() -> float:
        return float(10 ** rng.uniform(-2.0, 0.2)) / rate

    delays = []
    for j in range(count):
        feeds = bool(late and j == 0)
        strength = 0.0 if feeds and rng.random() < 0.7 else 0.3 / np.sqrt(n)
        inner = strength * rng.standard_normal((n, n)) * rate
        any_age = bool(rng.random() < 0.4)
        delays.append(Delay(lengths(), S[:, None] * inner / S, H(), feeds, any_age))
    q = int(rng.integers(1, 3))
    D = np.vstack([rng.standard_normal((1, n)), np.zeros((m, n))]) / S
    D2 = np.vstack([np.zeros((1, m)), 10 ** rng.uniform(-1.5, 0.5) * np.eye(m)])
    return DelaySystem(
        rate * S[:, None] * A / S,
        rate * S[:, None] * B,
        S[:, None] * rng.standard_normal((n, q)),
        D,
        None,
        D2,
        S[:, None] * 0.2 * rate * rng.standard_normal((n, 1)) if uncertain else None,
        H(),
        delays,
    )
