"""What the LMIs of a given loop have in common: units, the least gamma, the greatest margin.

Inside, time is counted in units of the loop's own speed and states are balanced; solutions come
back in the system's units. So too for the LMIs that design a gain for given multipliers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import numpy as np
import scipy

from cosim.hinf.certificate import joined
from cosim.hinf.lmi.conic import Constraint, Solution, solve
from cosim.hinf.lmi.parts import Labels, parts_of, solve_in_parts
from cosim.hinf.lmi.svec import Array, svec

if TYPE_CHECKING:
    from cosim.models import DelaySystem

_FLOOR = 1e-3  # the margin of the positive matrices beside that of Phi, relative
_TOLERANCE = 1e-8
_BOUND = 1e3
"""Largest of the positive matrices in the search for a margin, in the solver's own units.

Where w acts weakly they are larger by themselves: P counts in gamma / |C|^2.
"""
_GREATER_BOUND = 1e5  # where a great gain needs it
_SINGULAR = 1e12  # condition number of X beyond which Y X^-1 is noise

Variables = TypeVar("Variables")
Multiplier = TypeVar("Multiplier")
Constraints = tuple[list[Constraint], list[Constraint]]
"""-Phi at every corner; the other matrices, which are positive."""
Labelled = tuple[Labels, list[Labels | None]]


def own_units(loop: Sequence[Array]) -> tuple[Array, float]:
    """Return (n,) factors that balance the states of a loop, and its unit of time [s]."""
    speed = np.asarray(sum(np.abs(M) for M in loop))
    _, (scales, _) = scipy.linalg.matrix_balance(speed, permute=False, separate=True)
    back = 1.0 / np.asarray(scales, dtype=np.float64)
    rate = sum(float(np.linalg.norm(back[:, None] * M / back, 2)) for M in loop)
    return back, 1.0 / (rate or 1.0)


def _acting(system: DelaySystem) -> list[bool]:
    """Return whether u acts through x, and through every delayed x."""
    return [system.immediate_feedback, *(bool(delay.feedback) for delay in system.delays)]


def _widest_margin(
    constraints: Constraints,
    bound: float,
    accept: Callable[[Array], bool],
    *,
    enough: float,
    labels: Labelled | None = None,
    solver: Solver = solve,
) -> tuple[float, Array] | None:
    """Return the greatest margin and its point, which `accept` accepts; None if there is none.

    In a second round, unless the margin is below `enough`, it is counted against the diagonals of
    -Phi themselves.
    """
    phi, positive = constraints
    free = [c.less(np.zeros(c.constant.size)) for c in (c.below(bound) for c in positive)]
    floors = [c.less(svec(_FLOOR * np.eye(c.size))) for c in positive]
    last = np.zeros((1, phi[0].columns.shape[1] + 1))
    last[0, -1] = 1.0
    scales, found = [np.ones(c.size) for c in phi], None
    for _ in range(2):
        whole = [c.less(svec(np.diag(s))) for c, s in zip(phi, scales, strict=True)]
        bounded = [*whole, *floors, *free, Constraint(1, np.ones(1), -last)]
        solution = _solved(constraints, bounded, -last[0], labels, solver)
        if not solution.usable or not accept(solution.y[:-1]):
            break
        found = float(solution.y[-1]), solution.y[:-1]
        if found[0] <= enough:
            break
        scales = [np.maximum(np.diag(c.at(found[1])), 1e-9) for c in phi]
        greatest = max(float(s.max()) for s in scales)
        scales = [s / greatest for s in scales]
    return found


def _solved(
    constraints: Constraints,
    asked: Sequence[Constraint],
    q: Array,
    labels: Labelled | None,
    solver: Solver,
) -> Solution:
    """Minimise q'y over `asked`: -Phi, the positive matrices once or twice, and others."""
    if labels is None:
        return solver(asked, q, tolerance=_TOLERANCE)
    phi, positive = constraints
    rows = [*(labels[0] for _ in phi), *labels[1]]
    rows += labels[1] if len(asked) > len(phi) + len(positive) else ()
    rows += [None] * (len(asked) - len(rows))
    return solve_in_parts(asked, rows, q, tolerance=_TOLERANCE)


def named_blocks(system: DelaySystem) -> dict[str, tuple[slice, slice]]:
    """Return the name of the multiplier of every block of F, and the block."""
    blocks = system.blocks
    return {f"eps {i}" if len(blocks) > 1 else "eps": block for i, block in enumerate(blocks)}


def in_channel_units(
    system: DelaySystem, E: Array, H: Sequence[Array]
) -> tuple[Array, list[Array], Array]:
    """Return E and every H with p and q counted in units of their own for each block of F.

    They make the norms of E and H of a block equal, so that its eps is of the size of the others.
    A block that is alone keeps its units. The third value is the unit of p, (s,).
    """
    columns, rows = np.ones(E.shape[1]), np.ones(len(system.H))
    for p, q in system.blocks if len(system.blocks) > 1 else ():
        size = float(np.linalg.norm(E[:, p])), float(np.linalg.norm([M[q] for M in H]))
        if min(size) > 0:
            columns[p] = rows[q] = np.exp2(np.round(np.log2(size[1] / size[0]) / 2))
    return E * columns, [M / rows[:, None] for M in H], columns


class Solver(Protocol):
    """A solver of LMIs without parts."""

    def __call__(
        self, constraints: Sequence[Constraint], q: Array, *, tolerance: float
    ) -> Solution:
        """Minimise q'y over the constraints."""


class LoopLmi(ABC, Generic[Variables]):
    """The LMI of one loop, to be solved at any delays.

    Parameters
    ----------
    system : Eq. (7).
    K : (m, n) the gain, zero for the system as it is.
    performance : bound the gain from w to z, instead of stability alone.
    """

    _solver: Solver = staticmethod(solve)

    def __init__(self, system: DelaySystem, K: Array, *, performance: bool) -> None:
        self._performance = performance
        chosen = system.selections
        A = [system.A, *(delay.A for delay in system.delays)]
        loop = [M + system.B @ (K * S) if S.any() else M for M, S in zip(A, chosen, strict=True)]
        back, self._T = own_units(loop)
        self._back = back
        self._A = [self._T * back[:, None] * M / back for M in loop]
        self._C = self._T * back[:, None] * system.C
        E = self._T * back[:, None] * system.E
        H = [M / back for M in [system.H, *(delay.H for delay in system.delays)]]
        self._E, self._H, self._channel = in_channel_units(system, E, H)
        self._blocks = named_blocks(system)
        self._D = [((i == 0) * system.D + system.D2 @ (K * S)) / back for i, S in enumerate(chosen)]
        self._D1 = system.D1
        links = [("x", "x", A) for A in self._A] + [("x", "w", self._C), ("x", "p", self._E)]
        links += [("q", "x", H) for H in self._H]
        if performance:
            links += [*(("z", "x", D) for D in self._D), ("z", "w", self._D1)]
        self._links = links
        self._part = parts_of(links)

    def _multipliers(self, values: dict[str, Array]) -> Any:
        """Return the eps of a point in the system's own units."""
        units = [self._channel[columns][0] for columns, _ in self._blocks.values()]
        each = zip(self._blocks, units, strict=True)
        return joined([float(values[name][0, 0] / unit**2) for name, unit in each])

    @abstractmethod
    def unknowns(self, delays: Sequence[float]) -> int:
        """Return the number of unknowns, a measure of what a solve costs."""

    def least_gamma(self, delays: Sequence[float], reference: float) -> float | None:
        """Return the solver's least gamma near `reference`; None if it finds no point."""
        phi, positive = self._constraints(delays, reference, fixed=False)
        cost = np.zeros(phi[0].columns.shape[1])
        cost[-1] = 1.0
        labels = self._labels(delays)
        found = _solved((phi, positive), [*phi, *positive], cost, labels, self._solver)
        if not (found.usable and found.value > 0):
            return None
        return float(reference * np.sqrt(found.value))

    def central(
        self, delays: Sequence[float], gamma: float | None, *, down_to_zero: bool = False
    ) -> Variables | None:
        """Return a point of great margin at `gamma`; None if the solver finds none.

        `down_to_zero` : for every constant delay up to `delays`, not exactly these.
        """
        found = self.margin(delays, gamma, down_to_zero=down_to_zero)
        return None if found is None else found[1]

    def margin(
        self, delays: Sequence[float], gamma: float | None, *, down_to_zero: bool = False
    ) -> tuple[float, Variables] | None:
        """Return the greatest margin at `gamma`, and its point; negative: the LMI is not met."""
        bound = _BOUND
        if gamma is not None and self._C.any():
            bound *= max(1.0, gamma / float(np.linalg.norm(self._C, 2)) ** 2)
        constraints = self._constraints(delays, gamma or 1.0, fixed=True, down_to_zero=down_to_zero)
        found = _widest_margin(
            constraints,
            bound,
            lambda _: True,
            enough=-np.inf,
            labels=self._labels(delays),
            solver=self._solver,
        )
        if found is None:
            return None
        return found[0], self._variables(found[1], delays, gamma, down_to_zero=down_to_zero)

    def _labels(self, delays: Sequence[float]) -> Labelled | None:
        """Return the parts of the rows of -Phi, and of the positive matrices; None: uncut."""
        del delays
        return None

    @abstractmethod
    def _constraints(
        self,
        delays: Sequence[float],
        gamma: float,
        *,
        fixed: bool,
        down_to_zero: bool = False,
    ) -> Constraints:
        """Return the constraints; unless `fixed`, the last unknown is (the gain / `gamma`)^2."""

    @abstractmethod
    def _variables(
        self, point: Array, delays: Sequence[float], gamma: float | None, *, down_to_zero: bool
    ) -> Variables:
        """Return a point in the system's own units."""


class GainLmi(ABC, Generic[Multiplier]):
    """The LMI that designs a gain, convex for given multipliers.

    Its first unknowns are X (n, n; not symmetric) and Y (m, n), row by row: K = Y X^-1.

    Parameters
    ----------
    system : Eq. (7), with a positive delay.
    K : (m, n) a gain of about the expected size: it sets the units.
    reference : a gamma of about the expected size; None for stability alone.
    """

    def __init__(self, system: DelaySystem, K: Array, reference: float | None) -> None:
        self._reference = reference
        acts = _acting(system)
        open_A = [system.A, *(delay.A for delay in system.delays)]
        loop = [M + phi * system.B @ K for M, phi in zip(open_A, acts, strict=True)]
        back, self._T = own_units(loop)
        if reference is not None:
            back = back / (float(np.linalg.norm(self._T * back[:, None] * system.C, 2)) or 1.0)
        self._back, self._acts, size = back, acts, reference or 1.0
        self._A = [self._T * back[:, None] * M / back for M in open_A]
        self._B = self._T * back[:, None] * system.B
        self._C = self._T * back[:, None] * system.C
        E = self._T * back[:, None] * system.E
        H = [M / back for M in [system.H, *(delay.H for delay in system.delays)]]
        self._E, self._H, _ = in_channel_units(system, E, H)
        self._blocks = named_blocks(system)
        self._D, self._D1, self._D2 = system.D / back / size, system.D1 / size, system.D2 / size

    def least_gamma(self, multiplier: Multiplier) -> tuple[float, Array] | None:
        """Return the solver's least gamma and its gain; None if it finds none."""
        phi, positive = self._constraints(multiplier, None)
        cost = np.zeros(phi[0].columns.shape[1])
        cost[-1] = 1.0
        found = solve([*phi, *positive], cost, tolerance=_TOLERANCE)
        if not found.usable or self._reference is None or not found.y[-1] > 0:
            return None
        gain = self._gain(found.y)
        return None if gain is None else (float(self._reference * found.y[-1]), gain)

    def central(self, multiplier: Multiplier, gamma: float | None) -> tuple[float, Array] | None:
        """Return the greatest margin t at `gamma` and its gain; t < 0: the LMI is not met.

        None if the solver finds no point.
        """
        constraints, best = self._constraints(multiplier, gamma or 1.0), None
        for bound in (_BOUND, _GREATER_BOUND):
            found = _widest_margin(
                constraints, bound, lambda v: self._gain(v) is not None, enough=0.0
            )
            gain = None if found is None else self._gain(found[1])
            if found is not None and gain is not None:
                best = found[0], gain
                if found[0] > 0:
                    break
        return best

    def _gain(self, v: Array) -> Array | None:
        """Return K = Y X^-1 in the system's own units; None where X is singular."""
        n, m = self._B.shape
        X, Y = v[: n * n].reshape(n, n), v[n * n : n * (n + m)].reshape(m, n)
        if not np.linalg.cond(X) < _SINGULAR:
            return None
        return np.asarray(np.linalg.solve(X.T, Y.T).T * self._back)

    @abstractmethod
    def _constraints(self, multiplier: Multiplier, gamma: float | None) -> Constraints:
        """Return the constraints; gamma is the last unknown where it is None."""
