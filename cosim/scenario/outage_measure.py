"""Whether a run stayed within what is proved across outages (`cosim.hinf.Outages`).

Each interval between points is in touch (the measurement in use at most as old as designed for at
its end), out of touch with the proved fallback (the plant's control is zero), or neither: a value
that is held beyond the age, which nothing covers. Before the first measurement the state is
constant, so that a control of K x(0) is in touch up to that age.

Along the run V is bounded by B, B(0) = V(0), B' = -2 alpha B or 2 beta B, + gamma |w|^2; from rest
the gain is weighted as the proof says. `cosim.scenario.outage_value` computes V itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import ComponentInstance, Run
from cosim.scenario.measure import Measure, after
from cosim.scenario.outage_value import OutageValue
from cosim.scenario.performance import binding_for, vector_of
from cosim.scenario.run_events import Episodes, EventCollector, close_all
from cosim.scenario.signal_reader import reader_of
from cosim.trace import RunEvent

if TYPE_CHECKING:
    from cosim.scenario.designed_plant import DesignedPlant
    from cosim.scenario.signal_reader import SignalReader

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_DELAY = re.compile(r"delay\.d\d*$")
_PLACES = 500
_CLOSE = 1e-9
_ACCURACY = 1e-3
"""Relative, of V by the trapezoidal rule."""


@dataclass(frozen=True)
class OutageFigures:
    """What a run, or its zero-state run, says of the proof across outages.

    Attributes
    ----------
    bound : of the division of its time; None without any interval.
    uncovered_s : how long the plant held what was older than designed for [s].
    uncovered_at_s : since when, the first time [s]; None if never.
    value_ratio : largest V over its bound; None where w has no bound, or something was not covered.
    weighted_gain : (int s z'z / int s w'w)^(1/2); None without w or z.
    """

    bound: hinf.delay_lti.OutageBound | None
    uncovered_s: float
    uncovered_at_s: float | None
    value_ratio: float | None
    weighted_gain: float | None


class OutageMeasure(Measure[OutageFigures | None]):
    """The figures of a run whose design is proved across outages; None of a plant not known.

    `age` is to be called, as a watch of the ages of the measurements, before `add`.

    Parameters
    ----------
    plant : name of the plant.
    design : with the guarantee `outages`.
    seen_as : how the plant is seen as the system, where the design knows.
    end : of the run [s].
    set_points : the reference moves, so that V is not measured from the trim: no ratio, as where
        a delay of the plant is shorter than designed for.
    collector : gets an event when the guarantee is suspended, regained, or not covered any more.
    """

    def __init__(
        self,
        plant: str,
        design: hinf.Result,
        seen_as: DesignedPlant | None,
        end: float,
        *,
        set_points: bool,
        collector: EventCollector | None = None,
    ) -> None:
        proved = design.guarantees.outages
        if proved is None:
            raise ValueError("expected a design with a proof across outages")
        self._plant, self._design, self._proved = plant, design, proved
        self._system, self._seen_as, self._set_points = design.system, seen_as, set_points
        self._oldest_ns = self._system.feedback_delay * 1e9 * (1 + 1e-12)
        self._every_ns = max(int(end * 1e9 / _PLACES), 1)
        self._alpha, self._beta = float(proved.alpha), float(proved.beta)
        self._readers: tuple[SignalReader, ...] = ()
        self._ages: list[Integers] = []
        self._before: tuple[Any, ...] = (None, None, None, None)
        self._touch: list[NDArray[np.bool_]] = []
        self._points: list[Integers] = []
        self._covered_until: float | None = None
        self._uncovered_ns, self._measured = 0, False
        self._first_control: Reals | None = None
        self._deficit = 0.0
        self._value: OutageValue | None = None
        self._out = self._in = 0.0
        self._episodes = self._bad = None
        if collector is not None:
            words = "out of touch: the bound gamma is suspended"
            begins = RunEvent(0, "warning", "guarantee", plant, words)
            self._episodes = Episodes(collector, begins, "touch has made up for it: regained")
            words = "not covered: the control is held although older than designed for"
            begins = RunEvent(0, "error", "guarantee", f"{plant} control", words)
            self._bad = Episodes(collector, begins, "covered again")

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Bind the variables of the plant."""
        instance = next((s for s in instances if s.name == self._plant), None)
        binding = None if instance is None else binding_for(instance, self._system, self._seen_as)
        if instance is None or binding is None or len(binding.state.names) != len(self._system.A):
            return
        self._instance, self._binding = instance, binding
        self._readers = tuple(reader_of(instance, group.names) for group in binding)
        self._set_points |= self._has_shorter_delays(instance)
        self.reads_inputs = any(reader.reads_inputs for reader in self._readers)

    def _has_shorter_delays(self, plant: ComponentInstance) -> bool:
        """Whether a constant delay of the plant is not that of V; shorter ones are covered too."""
        component = plant.component
        own = {component.start_of(n) for n in component.description.ports if _DELAY.match(n)}
        constant = {x.d for x in self._system.delays if not (x.any_age or x.feedback)}
        return bool(constant) and not constant >= {d for d in own if d}

    def age(self, points_ns: Integers, ages_ns: Integers) -> None:
        """Take the ages of the measurements in use at the ends of intervals; -1: of none."""
        del points_ns
        self._ages.append(ages_ns)

    def add(self, first: int, last: int) -> None:
        """Take the intervals that end at the points."""
        ages = np.concatenate(self._ages) if self._ages else np.zeros(0, np.int64)
        self._ages = []
        if not self._readers:
            return
        x, u, w = (
            vector_of(group, reader.read(first, last))
            for group, reader in zip(self._binding, self._readers, strict=True)
        )
        here = self._instance.comm_points.points_ns[first:last], x, u, w
        points, x, u, w = (
            after(before, block) for before, block in zip(self._before, here, strict=True)
        )
        self._before = tuple(block[-1:].copy() for block in (points, x, u, w))
        if self._value is None and self._first_control is None:
            self._first_control = x[0] @ self._design.K.T
            self._value = OutageValue(
                self._proved, self._system, x[0], int(points[0]), self._every_ns
            )
        if points.size < 2 or ages.size != points.size - 1:
            return
        touch, covered = self._modes(points, ages, u[:-1])
        self._note(points, touch, covered)
        self._integrate(points, x, u[:-1], w[:-1], touch)

    def _modes(
        self, points: Integers, ages: Integers, u: Reals
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which intervals are in touch, and which are covered."""
        used = ages >= 0
        touch = used & (ages <= self._oldest_ns)
        if not self._measured and self._first_control is not None:
            early = (np.cumsum(used) == 0) & (points[1:] <= self._oldest_ns)
            size = np.abs(self._first_control).max(initial=0.0)
            same = np.abs(u - self._first_control) <= _CLOSE * size
            touch |= early & same.all(axis=1)
            self._measured = bool(used.any())
        zero = (u == 0.0).all(axis=1) & (not self._proved.fallback.any())
        return touch, touch | zero

    def _note(self, points: Integers, touch: NDArray[np.bool_], covered: NDArray[np.bool_]) -> None:
        """Keep the division of time, and make its events."""
        self._points.append(points if not self._points else points[1:])
        self._touch.append(touch)
        wrong = np.flatnonzero(~covered)
        if wrong.size:
            self._uncovered_ns += int(np.diff(points)[wrong].sum())
            if self._covered_until is None:
                self._covered_until = self._instance.comm_points.at_s(int(points[wrong[0]]))
        if self._episodes is None or self._bad is None:
            return
        self._bad.add(points[:-1], ~covered)
        suspended = np.empty(touch.size, np.bool_)
        for k, (own, h) in enumerate(zip(touch.tolist(), np.diff(points).tolist(), strict=True)):
            self._deficit = max(
                self._deficit + h / 1e9 * (-2 * self._alpha if own else 2 * self._beta), 0.0
            )
            suspended[k] = not own or self._deficit > 0.0
        self._episodes.add(points[:-1], suspended)

    def _integrate(
        self, points: Integers, x: Reals, u: Reals, w: Reals, touch: NDArray[np.bool_]
    ) -> None:
        """Go on with V, its bound, and the weighted integrals."""
        h = np.diff(points) / 1e9
        rates = np.where(touch, -2 * self._alpha, 2 * self._beta)
        noise = (w * w).sum(axis=1)
        if self._value is not None:
            self._value.add(points, x, rates, noise)
        if self._proved.gamma is None:
            return
        s = self._system
        direct = w @ s.D1.T + u @ s.D2.T
        ends = [((x_end @ s.D.T + direct) ** 2).sum(axis=1) for x_end in (x[:-1], x[1:])]
        drive = zip(h.tolist(), rates.tolist(), noise.tolist(), *(e.tolist() for e in ends),
                    strict=True)  # fmt: skip
        # both integrals over the weight at their end, which stays in range
        for span, rate, own, begin, end in drive:
            grown = math.exp(rate * span)
            self._in = self._in * grown + own * span * (grown + 1) / 2
            self._out = self._out * grown + span * (begin * grown + end) / 2

    def result(self, run: Run) -> OutageFigures | None:
        """Return the figures."""
        close_all([e for e in (self._episodes, self._bad) if e is not None], run.end_ns)
        if not self._readers or not self._touch or self._value is None:
            return None
        begin_ns = self._instance.comm_points.start_ns  # times are those of the components
        times = (np.concatenate(self._points) + begin_ns) / 1e9
        touch = np.concatenate(self._touch)
        bounded = self._covered_until is None and not self._set_points
        weighted = None
        if self._proved.gamma is not None and self._in > 0 and self._covered_until is None:
            weighted = math.sqrt(self._out / self._in)
        return OutageFigures(
            bound=hinf.delay_lti.outage_bound(self._proved, times, touch),
            uncovered_s=self._uncovered_ns / 1e9,
            uncovered_at_s=self._covered_until,
            value_ratio=self._value.ratio if bounded and run.status != "failed" else None,
            weighted_gain=weighted,
        )


def outage_figures(
    proved: hinf.certificate.Outages, run: OutageFigures | None, at_rest: OutageFigures | None
) -> dict[str, Any] | None:
    """Return the metric `outages`, JSON-safe; None where the run has no division of time."""
    if run is None or run.bound is None:
        return None
    bound, gamma = run.bound, None if proved.gamma is None else float(proved.gamma)
    found: dict[str, Any] = {
        "alpha": float(proved.alpha),
        "beta": float(proved.beta),
        "gamma": gamma,
        **{key: value for key, value in vars(bound).items() if key != "suspensions_s"},
        "suspensions_s": [list(each) for each in bound.suspensions_s[:_MOST_SUSPENSIONS]],
        "suspensions": len(bound.suspensions_s),
        "uncovered_s": run.uncovered_s,
        "uncovered_at_s": run.uncovered_at_s,
        "value_ratio": run.value_ratio,
        "value_within_bound": None if run.value_ratio is None else run.value_ratio <= 1 + _ACCURACY,
        "weighted_gain": None,
        "weighted_gain_within_gamma": None,
        "plain_gain_bound": None,
    }
    if gamma is not None and run.uncovered_at_s is None and bound.gain_factor is not None:
        found["plain_gain_bound"] = gamma * bound.gain_factor
    if gamma is not None and at_rest is not None and at_rest.weighted_gain is not None:
        found["weighted_gain"] = at_rest.weighted_gain
        found["weighted_gain_within_gamma"] = at_rest.weighted_gain <= gamma * (1 + _ACCURACY)
    return found


_MOST_SUSPENSIONS = 200

Watch = Callable[[Integers, Integers], None]


def both(first: Watch, second: Watch | None) -> Watch:
    """Return a watch that passes ages on to one or two others."""
    if second is None:
        return first

    def watch(points_ns: Integers, ages_ns: Integers) -> None:
        first(points_ns, ages_ns)
        second(points_ns, ages_ns)

    return watch
