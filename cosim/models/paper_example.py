"""The example of the paper's section 5, as plain tuples: Eq. (7) with one delay.

The paper prints scalars in place of matrices. They are read as follows (no other reading
reproduces the paper's Table 2 either):

- D = -1 is -I2 and E = -0.1 is -0.1 I2,
- C is 2x1, so w is scalar: the first component of the exosystem's state, w' = G w,
- F(t) = 0.5 sin t is that scalar times I2.

Standard library only at module level: this file is also part of an FMU.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cosim.models.delay_system import DelaySystem

A = ((-5.0, 0.0), (6.0, -10.0))
A1 = ((-1.0, 0.0), (2.0, 1.0))
B = ((-1.0,), (3.0,))
C = ((4.0,), (3.0,))
D = ((-1.0, 0.0), (0.0, -1.0))
D1 = ((4.0,), (3.0,))
D2 = ((3.0,), (-1.0,))
E = ((-0.1, 0.0), (0.0, -0.1))
H = ((0.2, 0.0), (1.0, 2.0))
H1 = ((-1.0, 2.0), (0.0, -0.3))
G = ((0.0, 1.0), (-1.0, 0.0))
"""Exosystem of the disturbance, w' = G w."""

d = 0.3
"""Delay [s]."""

F_AMPLITUDE = 0.5
F_OMEGA = 1.0
"""F(t) = F_AMPLITUDE sin(F_OMEGA t) I2, F_OMEGA in rad/s."""

INITIAL_STATE = (10.0, 10.0)

GAMMA = 5.0
"""The gain the paper chooses; every gain must exceed |D1| = 5, so it is not achievable."""

K1 = 0.6
K2 = 0.2
PRINTED_K = (0.6432, -0.5679)

TABLE_2 = (
    (4.0, 0.98),
    (5.0, 1.05),
    (6.0, 1.07),
    (8.0, 1.09),
    (10.0, 1.11),
    (13.0, 1.12),
    (20.0, 1.15),
)
"""Table 2 as printed: (gamma, greatest delay d* [s])."""


def system(delay: float = d) -> DelaySystem:
    """Return section 5 as a `DelaySystem` (n = 2, m = 1, q = 1, p = 2) with this delay [s]."""
    # numpy is not part of an FMU; only designs need this function
    from cosim.models.delay_system import Delay, DelaySystem  # noqa: PLC0415

    return DelaySystem(A, B, C, D, D1, D2, E, H, (Delay(delay, A1, H1),), name="paper")
