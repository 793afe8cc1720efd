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

from cosim.master import ComponentInstance, Run
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.measure import Measure, own_points_in

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

    states: tuple[str, ...]
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


class StepLaw(Measure[list[Departure]]):
    """Where a component left its equation for the first time; empty if it never did.

    Parameters
    ----------
    component : its name.
    equation : of an instance of it; None if it is not known, which is a departure.
    read : returns x, (n, states), and the u held from each row on, (n, inputs), at the points
        first to last - 1.
    later : the entries of u that the rows show at the end of a step, not at its beginning.
    """

    def __init__(
        self,
        component: str,
        equation: Callable[[ComponentInstance], Equation | None],
        read: Callable[[ComponentInstance], Callable[[int, int], tuple[Reals, Reals]]],
        *,
        later: slice = _NONE,
    ) -> None:
        self._later = later
        self._component, self._make_equation, self._make_read = component, equation, read
        self._equation: Equation | None = None
        self._found: Departure | None = None
        self._times, self._x, self._u = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
        self._compared = 0
        self._greatest = 0.0
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the states and the inputs."""
        instance = next((s for s in instances if s.name == self._component), None)
        if instance is None:
            return
        self._instance = instance
        self._equation = self._make_equation(instance)
        if self._equation is None:
            words = "a step of the plant of the design"
            self._found = Departure(self._component, words, "a plant that the design does not know")
            return
        self._read = self._make_read(instance)
        self._start_s = instance.comm_points.start_ns / 1e9

    def add(self, first: int, last: int) -> None:
        """Compare steps that end at the points."""
        if self._equation is None or self._found is not None:
            return
        own = own_points_in(self._instance, first, last)
        x, u = self._read(first, last)
        if not own.size:
            return
        times = self._instance.comm_points.points_ns[own] / 1e9
        known = self._times.size
        self._times = np.concatenate((self._times, times))
        here = own - first
        self._x = np.vstack((self._x, x[here])) if known else x[here]
        self._u = np.vstack((self._u, u[here])) if known else u[here]
        if self._times.size > 1:
            with np.errstate(all="ignore"):
                self._compare(max(known - 1, 0))
        self._forget()

    def _forget(self) -> None:
        """Forget what no delay reaches back to."""
        longest = max(self._equation.delays, default=0.0) if self._equation is not None else 0.0
        kept = int(np.searchsorted(self._times, self._times[-1] - longest, side="right")) - 2
        kept = min(max(kept, 0), self._times.size - 1)
        # the state before the first point is constant: the first row stands for it
        if kept > 0:
            self._times, self._x, self._u = self._times[kept:], self._x[kept:], self._u[kept:]

    def _compare(self, begin: int) -> None:
        """Compare some of the steps from row `begin` on."""
        if self._equation is None:
            return
        change = np.abs(np.diff(self._x, axis=0)).max(axis=1)
        steps = self._chosen(change, begin)
        so_far = np.maximum.accumulate(np.abs(self._x[begin:-1]).max(axis=1))
        greatest = np.maximum(so_far, self._greatest)[steps - begin]
        self._greatest = max(self._greatest, _finite(np.abs(self._x[begin:])))
        start, end = self._x[steps], self._x[steps + 1]
        found = self._integrated(steps)
        allowed = _SHARE * np.maximum(change[steps], np.abs(found - start).max(axis=1))
        allowed = np.minimum(allowed, _SHARE * np.maximum(change[steps], greatest))
        error = np.abs(self._unexplained(steps, found, end)).max(axis=1)
        # a solution beyond all numbers is left by a state that is a number
        wrong = ~(error <= allowed + _ROUNDING * greatest)
        if wrong.any():
            k = int(np.argmax(wrong))
            j = int(
                np.nanargmax(np.where(np.isfinite(found[k]), np.abs(found[k] - end[k]), np.inf))
            )
            name, at = self._equation.states[j], float(self._times[steps[k] + 1]) + self._start_s
            self._found = Departure(
                f"{self._component}.{name}",
                f"{found[k, j]:.6g}, from the state a step before by the equations of the design",
                f"{end[k, j]:.6g}",
                at,
            )

    def _chosen(self, change: Reals, begin: int) -> Integers:
        """Return the rows from which steps are compared, ascending."""
        count = change.size - begin
        spread = np.linspace(begin, change.size - 1, min(count, _SPREAD)).astype(np.int64)
        moved = np.nan_to_num(change[begin:], nan=np.inf)
        largest = begin + np.argsort(moved, kind="stable")[-_GREATEST:]
        first = np.arange(begin, begin + min(count, _FIRST if not self._compared else 0))
        self._compared += count
        return _distinct(np.concatenate((spread, largest, first)))

    def _unexplained(self, steps: Integers, found: Reals, end: Reals) -> Reals:
        """Return the error of each step that no value of an unrecorded input explains."""
        error = end - found
        unknown = () if self._equation is None else self._equation.unknown
        if not unknown or not np.isfinite(error).all():
            return error
        moved = [self._integrated(steps, more=j) - found for j in unknown]
        effects = np.stack(moved, axis=2)
        shares = np.linalg.pinv(effects) @ error[:, :, None]
        return np.asarray(error - (effects @ shares)[:, :, 0])

    def _integrated(self, steps: Integers, more: int | None = None) -> Reals:
        """Return the state at the end of each step, (steps, states); one input greater by 1."""
        equation = self._equation
        if equation is None:
            return np.zeros((0, 0))
        begin, end = self._times[steps], self._times[steps + 1]
        parts = int(np.clip(np.ceil((end - begin).max() / equation.step), 2, _MOST_SUBSTEPS))
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
        return np.column_stack([np.broadcast_to(a, steps.shape) for a in x])

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
            late = [
                list(self._between(t - d)) for d in ([] if equation is None else equation.delays)
            ]
            rates = [] if equation is None else equation.rates(t + self._start_s, x, late, u)
            slopes.append(np.stack([np.broadcast_to(a, steps.shape) for a in rates]))
        return _Past(
            times[steps],
            times[steps + 1] - times[steps],
            self._x[steps].T,
            self._x[steps + 1].T,
            (slopes[0], slopes[1]),
        )

    def _between(self, t: Reals) -> Reals:
        """Return the recorded state at instants, on a line between points; (states, instants)."""
        times = self._times
        place = np.clip(np.searchsorted(times, t, side="right") - 1, 0, times.size - 2)
        share = np.clip((t - times[place]) / (times[place + 1] - times[place]), 0.0, 1.0)
        return np.asarray(
            (self._x[place] + share[:, None] * (self._x[place + 1] - self._x[place])).T
        )

    def result(self, run: Run) -> list[Departure]:
        """Return where the equation was left."""
        del run
        return [] if self._found is None else [self._found]


def _distinct(rows: Integers) -> Integers:
    """Return row numbers, each once, ascending; `np.unique` loads a module of its own for that."""
    ordered = np.sort(rows)
    return ordered[np.concatenate(([True], ordered[1:] != ordered[:-1]))]


def _finite(values: Reals) -> float:
    """Return the greatest finite number among values; 0 without one."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))
