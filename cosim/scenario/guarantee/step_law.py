"""The law of a component that is a delay equation: each step against a finer one.

    x' = f(t, x(t), x(t - d_1), ..., x(t - d_N), u),   u held from point to point

What a run has recorded at its points is a solution of this equation, or it is not. At some of the
steps, the first ones, those with the greatest changes and others spread evenly, the state at the
beginning is integrated with the equations of the design (classical Runge-Kutta of order four in
steps that are fine enough for its fastest root) and compared with the state at the end. Delayed
values come from the recorded states, by a cubic Hermite interpolant with one-sided slopes. So a
plant that is integrated too coarsely, that is another one, or on which something acts that the
design does not know, is found without knowing what its FMU does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.first_departure import departed
from cosim.scenario.measure import Fold
from cosim.scenario.signal_reader import Block, History

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_SHARE = 1e-2
"""Greatest error of a step, as a share of the greatest change in it."""
_ROUNDING = 1e-6
"""The same as a share of the greatest value of the state so far."""
_SPREAD, _GREATEST, _FIRST = 64, 24, 8
"""Steps that are compared in a block: spread evenly, with the greatest changes, the first."""
_MOST_SUBSTEPS = 400
_NONE = slice(0, 0)


class ArrayFunctions:
    """The namespace of functions for equations over arrays."""

    sin, cos, sqrt, exp = np.sin, np.cos, np.sqrt, np.exp
    atan2, asin = np.arctan2, np.arcsin
    min, max = np.minimum, np.maximum


Rates = Callable[
    [Reals, Sequence[Reals], Sequence[Sequence[Reals]], Sequence[Reals]], Sequence[Any]
]
"""t, x, [x(t - d_1), ...] and u to x': lists of arrays over many steps at once."""


OwnRows = tuple[Integers, Reals]
"""The own points of a block, after the last one before it [ns], (n,), and x and u there, (n, k)."""


@dataclass(frozen=True)
class Equation:
    """A delay equation.

    Attributes
    ----------
    states : names of x, of variables.
    rates : x'.
    delays : d_1 ... d_N [s].
    step : so long may a step of Runge-Kutta be [s].
    unknown : the entries of u that events set, and no row shows: any value of them will do.
    """

    states: Sequence[str]
    rates: Rates
    delays: tuple[float, ...]
    step: float
    unknown: tuple[int, ...] = ()


class _Past(NamedTuple):
    """Some recorded steps: when they begin, how long they are, states and slopes at both ends."""

    begin: Reals
    length: Reals
    first: Reals
    last: Reals
    slopes: tuple[Reals, Reals]

    def at(self, t: Reals) -> list[Reals]:
        """Return the state at instants by a cubic Hermite interpolant; constant before it."""
        place = np.clip(np.searchsorted(self.begin, t, side="right") - 1, 0, self.begin.size - 1)
        length = self.length[place]
        s = np.clip((t - self.begin[place]) / length, 0.0, 1.0)
        a, b = self.first[:, place], self.last[:, place]
        p, q = (slope[:, place] * length for slope in self.slopes)
        z = 1 - s
        return list(z * z * ((1 + 2 * s) * a + s * p) + s * s * ((3 - 2 * s) * b - z * q))


def step_law(
    instance: ComponentInstance,
    equation: Equation,
    own_rows: Callable[[Block], OwnRows],
    *,
    later: slice = _NONE,
) -> Fold[list[Departure]]:
    """Measure where a component left its equation for the first time; empty if it never did.

    Parameters
    ----------
    own_rows : reads a block; u is held from each own point on.
    later : the entries of u that the rows show at the end of a step, not at its beginning.
    """
    steps = _Steps(equation, later, instance.comm_points.start_ns / 1e9)
    while block := (yield):
        if left := steps.compared(*own_rows(block)):
            return departed(instance, *left)
    return []


class _Steps:
    """The steps of a component so far, as far back as its delays reach."""

    def __init__(self, equation: Equation, later: slice, start_s: float) -> None:
        self._equation, self._later, self._start_s = equation, later, start_s
        self._history = History()  # of x and u
        self._compared = 0
        self._greatest = 0.0

    def compared(self, points: Integers, rows: Reals) -> tuple[str, str, str, int] | None:
        """Compare steps between own points [ns]; return variable, expected, got and when [ns]."""
        known = self._history.times.size
        self._history.add(points / 1e9, rows)
        self._times = self._history.times
        self._x, self._u = np.split(self._history.values, [len(self._equation.states)], axis=1)
        left = None
        if self._times.size > max(known, 1):
            with np.errstate(all="ignore"):
                left = self._compare(max(known - 1, 0))
        # the state before the first point is constant: the first row stands for it
        self._history.forget(self._times[-1] - max(self._equation.delays, default=0.0))
        return left

    def _compare(self, begin: int) -> tuple[str, str, str, int] | None:
        """Compare some of the steps from row `begin` on."""
        columns = np.ascontiguousarray(self._x.T)
        change = np.abs(np.diff(columns)).max(axis=0)
        steps = self._chosen(change, begin)
        size = np.abs(columns[:, begin:])
        so_far = np.maximum.accumulate(size.max(axis=0))
        greatest = np.maximum(so_far, self._greatest)[steps - begin]
        self._greatest = max(self._greatest, _finite(size))
        start, end = self._x[steps], self._x[steps + 1]
        found = self._integrated(steps)
        allowed = _SHARE * np.maximum(change[steps], np.abs(found - start).max(axis=1))
        allowed = np.minimum(allowed, _SHARE * np.maximum(change[steps], greatest))
        error = np.abs(self._unexplained(steps, found, end)).max(axis=1)
        # a solution beyond all numbers is left by a state that is a number
        wrong = ~(error <= allowed + _ROUNDING * greatest)
        if not wrong.any():
            return None
        k = int(np.argmax(wrong))
        apart = np.where(np.isfinite(found[k]), np.abs(found[k] - end[k]), np.inf)
        j = int(np.nanargmax(apart))
        expected = f"{found[k, j]:.6g}, from the state a step before by the equations of the design"
        at_ns = round(float(self._times[steps[k] + 1]) * 1e9)
        return self._equation.states[j], expected, f"{end[k, j]:.6g}", at_ns

    def _chosen(self, change: Reals, begin: int) -> Integers:
        """Return the rows from which steps are compared, ascending."""
        count = change.size - begin
        spread = np.linspace(begin, change.size - 1, min(count, _SPREAD)).astype(np.int64)
        moved = np.nan_to_num(change[begin:], nan=np.inf)
        largest = begin + np.argpartition(moved, -min(_GREATEST, count))[-_GREATEST:]
        first = np.arange(begin, begin + min(count, _FIRST if not self._compared else 0))
        self._compared += count
        return _distinct(np.concatenate((spread, largest, first)))

    def _unexplained(self, steps: Integers, found: Reals, end: Reals) -> Reals:
        """Return the error of each step that no value of an unrecorded input explains."""
        error = end - found
        unknown = self._equation.unknown
        if not unknown or not np.isfinite(error).all():
            return error
        moved = [self._integrated(steps, more=j) - found for j in unknown]
        effects = np.stack(moved, axis=2)
        shares = np.linalg.pinv(effects) @ error[:, :, None]
        return np.asarray(error - (effects @ shares)[:, :, 0])

    def _integrated(self, steps: Integers, more: int | None = None) -> Reals:
        """Return the state at the end of each step, (steps, states); one input greater by 1."""
        equation = self._equation
        begin, end = self._times[steps], self._times[steps + 1]
        parts = int(np.clip(np.ceil((end - begin).max() / equation.step), 1, _MOST_SUBSTEPS))
        h = (end - begin) / parts
        x = list(self._x[steps].T.copy())
        u = list(self._inputs_during(steps).T)
        if more is not None:
            u[more] = u[more] + 1.0
        past = {d: self._past(begin - d, end - d) for d in set(equation.delays) if d > 0}

        def f(t: Reals, x: Sequence[Reals]) -> list[Reals]:
            late = [x if d == 0 else past[d].at(t - d) for d in equation.delays]
            return list(equation.rates(t + self._start_s, x, late, u))

        for k in range(parts):
            t = begin + k * h
            k1 = f(t, x)
            k2 = f(t + h / 2, [a + h / 2 * b for a, b in zip(x, k1, strict=True)])
            k3 = f(t + h / 2, [a + h / 2 * b for a, b in zip(x, k2, strict=True)])
            k4 = f(t + h, [a + h * b for a, b in zip(x, k3, strict=True)])
            x = [
                a + h / 6 * (p + 2 * q + 2 * r + s)
                for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True)
            ]
        return _rows(x, steps.size).T

    def _inputs_during(self, steps: Integers) -> Reals:
        """Return what is held during steps, (steps, inputs)."""
        inputs = self._u[steps]
        inputs[:, self._later] = self._u[steps + 1][:, self._later]
        return inputs

    def _past(self, first: Reals, last: Reals) -> _Past:
        """Return the recorded state between instants, with the slopes of the steps there."""
        equation, times = self._equation, self._times
        ends = [np.searchsorted(times, t, side="right") - 1 for t in (first, last)]
        low, high = (np.clip(end, 0, times.size - 2) for end in ends)
        every = np.arange(int((high - low).max(initial=0)) + 1)
        steps = _distinct(np.minimum(low[:, None] + every, high[:, None]).ravel())
        u = list(self._inputs_during(steps).T)
        slopes = []
        for rows in (steps, steps + 1):
            t, x = times[rows], list(self._x[rows].T)
            late = [list(self._history.at(t - d)[0][:, : len(x)].T) for d in equation.delays]
            rates = equation.rates(t + self._start_s, x, late, u)
            slopes.append(_rows(rates, steps.size))
        return _Past(
            times[steps],
            times[steps + 1] - times[steps],
            self._x[steps].T,
            self._x[steps + 1].T,
            (slopes[0], slopes[1]),
        )


def _rows(values: Sequence[Any], count: int) -> Reals:
    """Return an array with a row for each value, which may be one number for all; (n, count)."""
    rows = np.empty((len(values), count))
    for row, value in zip(rows, values, strict=True):
        row[:] = value
    return rows


def _distinct(rows: Integers) -> Integers:
    """Return row numbers, each once, ascending; `np.unique` loads a module of its own for that."""
    ordered = np.sort(rows)
    return ordered[np.concatenate(([True], ordered[1:] != ordered[:-1]))]


def _finite(values: Reals) -> float:
    """Return the greatest finite number among values; 0 without one."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))
