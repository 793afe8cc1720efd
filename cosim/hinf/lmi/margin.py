"""The greatest margin by which matrix inequalities can be met, and a point in their middle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from cosim.hinf.lmi.conic import Constraint, Solution, solve
from cosim.hinf.lmi.svec import Array, svec

TOLERANCE = 1e-8
_FLOOR = 1e-3
"""The margin of the other matrices beside that of the main ones, relative."""


class Solver(Protocol):
    """What minimises over constraints: `conic.solve` or `interior_point.solve_dense`."""

    def __call__(
        self, constraints: Sequence[Constraint], q: Array, *, tolerance: float
    ) -> Solution:
        """Minimise q'y over the constraints."""


def widest_margin(
    main: Sequence[Constraint],
    others: Sequence[Constraint],
    bound: float,
    *,
    accept: Callable[[Array], bool] = lambda _: True,
    enough: float = -np.inf,
    solver: Solver = solve,
) -> tuple[float, Array] | None:
    """Return the greatest margin and its point, which `accept` accepts; None if there is none.

    In a second round, unless the margin is below `enough`, it is counted against the diagonals of
    the main matrices themselves. The others are at most `bound`.
    """
    free = [c.less(np.zeros(c.constant.size)) for c in (c.below(bound) for c in others)]
    floors = [c.less(svec(_FLOOR * np.eye(c.size))) for c in others]
    last = np.zeros((1, main[0].columns.shape[1] + 1))
    last[0, -1] = 1.0
    scales, centre = [np.ones(c.size) for c in main], None
    for _ in range(2):
        asked = [c.less(svec(np.diag(s))) for c, s in zip(main, scales, strict=True)]
        bounded = [*asked, *floors, *free, Constraint(1, np.ones(1), -last)]
        solution = solver(bounded, -last[0], tolerance=TOLERANCE)
        # where the solver fails with a margin, its point is tried as well: the proof decides
        tried = solution.usable or bool(np.isfinite(solution.y).all() and solution.y[-1] > 0.0)
        if not tried or not accept(solution.y[:-1]):
            break
        centre = float(solution.y[-1]), solution.y[:-1]
        if centre[0] <= enough:
            break
        scales = [np.maximum(np.diag(c.at(centre[1])), 1e-9) for c in main]
        greatest = max(float(s.max()) for s in scales)
        scales = [s / greatest for s in scales]
    return centre
