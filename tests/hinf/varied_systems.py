"""Systems of varied shape for designs, from a seed, and chains of masses."""

from __future__ import annotations

import numpy as np

from cosim.models.delay_system import Delay, DelaySystem

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


def varied_system(seed: int) -> DelaySystem:
    """Return a system of one to four states, up to two delays, stable or not, uncertain or not."""
    rng = np.random.default_rng([14, seed])
    n, m, q = int(rng.integers(1, 5)), int(rng.integers(1, 3)), int(rng.integers(1, 3))
    count = int(rng.choice([0, 1, 1, 1, 2]))
    scale = float(10 ** rng.uniform(-0.7, 0.5))
    late = bool(count and rng.random() < 0.5)
    uncertain = rng.random() < 0.3

    def r(*shape: int) -> np.ndarray:
        return scale * rng.standard_normal(shape)

    def H() -> np.ndarray | None:
        return 0.1 * rng.standard_normal((1, n)) if uncertain else None

    delays = tuple(
        Delay(
            float(10 ** rng.uniform(-1.3, 0.3)) / scale,
            0.3 * r(n, n) if not (late and j == 0 and rng.random() < 0.6) else np.zeros((n, n)),
            H(),
            feedback=late and j == 0,
            any_age=bool(rng.random() < 0.3),
        )
        for j in range(count)
    )
    D = np.vstack([rng.standard_normal((1, n)), np.zeros((m, n))])
    D2 = np.vstack([np.zeros((1, m)), 10 ** rng.uniform(-1.5, 0.5) * np.eye(m)])
    return DelaySystem(
        r(n, n) - rng.uniform(-0.5, 1.5) * scale * np.eye(n),
        scale * rng.standard_normal((n, m)),
        rng.standard_normal((n, q)),
        D,
        None,
        D2,
        0.2 * r(n, 1) if uncertain else None,
        H(),
        delays,
    )
