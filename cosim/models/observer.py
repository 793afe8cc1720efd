"""An observer on board: measurements that are late, and u = K xh through an actuator allocation.

    xh'(t) = A xh(t) + sum_j A_j xh(t-d_j) + B u(t) + sum_i L_i innovation_i
    innovation_i = y_i - C_i xh(s_i)

y_i was measured at s_i and arrives later; its innovation compares it with the estimate that was
stored at s_i, is computed when it arrives, and is held until the next one does. u is what acts:
after the limits, and after the play-out of a command link. The right-hand side is
`linear_derivatives` with L for C and the innovations for w. Standard library only: this file is
also part of the FMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.models.delay_line import DelayLine
from cosim.models.products import Matrix, product


class EstimateLine(DelayLine):
    """A delay line whose `at` reaches back as far as a measurement may be old.

    Parameters are those of `DelayLine`, and `memory` : how far `at` reaches back [s].
    """

    def __init__(
        self,
        initial: Sequence[float],
        delays: Sequence[float],
        step: float,
        start: float,
        memory: float,
    ) -> None:
        super().__init__(initial, delays, step, start)
        self._longest = max(self._longest, memory)


def innovation(y: Sequence[Any], C: Matrix, stored: Sequence[Any]) -> list[Any]:
    """Return y - C xh(s), length k, for y measured at s and the estimate `stored` of then (n,)."""
    return [a - b for a, b in zip(y, product(C, stored), strict=True)]


def acting_control(
    commands: Sequence[Any], trim: Sequence[Any], allocation: Matrix | None
) -> list[Any]:
    """Return the control u (m,) that limited commands (r,) give: allocation (commands - trim).

    `trim` is empty where commands are deviations, `allocation` (m, r) None where they are u.
    """
    moved = [a - b for a, b in zip(commands, trim, strict=True)] if trim else list(commands)
    return moved if allocation is None else product(allocation, moved)
