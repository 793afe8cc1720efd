"""Whether a run stayed within what is proved across outages (`cosim.hinf.Outages`).

In each interval between points the link is up (the measurement in use at most as old as designed
for at its end), or it is an outage with the proved fallback (the plant's control is zero), or
neither: a value that is held beyond the age, which nothing covers. Before the first measurement
the state is constant, so that a control of K x(0) counts as link up until that age.

Along the run V is bounded by B, B(0) = V(0), B' = -2 alpha B or 2 beta B, + gamma |w|^2; from rest
the gain is weighted as the proof says. `cosim.scenario.outage_value` computes V itself.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import Algorithm, Component
from cosim.models import DelaySystem
from cosim.scenario.age import ages_at
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.outage_value import OutageValue
from cosim.scenario.performance import vectors_of
from cosim.scenario.run_events import Episodes, EventCollector
from cosim.scenario.stamps import FeedbackStamps

if TYPE_CHECKING:
    from cosim.scenario.designed_plant import DesignedPlant

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


@measure
def measured_outages(
    run: MeasuredRun,
    plant: str,
    controller: str,
    algorithm: Algorithm,
    design: hinf.Result,
    seen_as: DesignedPlant | None,
    end: float,
    *,
    set_points: bool,
    collector: EventCollector | None = None,
) -> Fold[OutageFigures | None]:
    """Measure the figures of a run whose design is proved across outages.

    None of a plant that is not known, and without any interval.

    Parameters
    ----------
    plant, controller : names of the components; algorithm : of the run.
    design : with the guarantee `outages`.
    seen_as : how the plant is seen as the system, where the design knows.
    end : of the run [s].
    set_points : the reference moves, so that V is not measured from the trim: no ratio, as where
        a delay of the plant is shorter than designed for.
    collector : gets an event when the guarantee is suspended, regained, or not covered any more.
    """
    proved, system = design.guarantees.outages, design.system
    if proved is None:
        raise ValueError("expected a design with a proof across outages")
    vectors = vectors_of(run, plant, system, seen_as)
    loop = run.shared(FeedbackStamps, plant, controller, algorithm)
    ways = loop.ways()
    if vectors is None or len(vectors[0].group.names) != len(system.A) or not ways:
        return None
    set_points |= _has_shorter_delays(system, run.instances[plant].component)
    every_ns = max(int(end * 1e9 / _PLACES), 1)
    division = _Division(proved, system.feedback_delay, plant, collector)
    value, energy_in, energy_out = None, 0.0, 0.0
    while block := (yield):
        x, u, w = (vector.read(block) for vector in vectors)
        points, (oldest, _) = run.points_ns(block), loop.in_use(block, ways)
        if value is None:
            first_control = x[0] @ design.K.T
            value = OutageValue(proved, system, x[0], int(points[0]), every_ns)
        if points.size < 2:
            continue
        u, w, h = u[:-1], w[:-1], np.diff(points) / 1e9
        touch = division.add(points, ages_at(points[1:], oldest), u, first_control)
        rates = np.where(touch, -2 * division.alpha, 2 * division.beta)
        noise = (w * w).sum(axis=1)
        value.add(points, x, rates, noise)
        if proved.gamma is None:
            continue
        direct = w @ system.D1.T + u @ system.D2.T
        ends = [((x_end @ system.D.T + direct) ** 2).sum(axis=1) for x_end in (x[:-1], x[1:])]
        drive = zip(h.tolist(), rates.tolist(), noise.tolist(), *(e.tolist() for e in ends),
                    strict=True)  # fmt: skip
        # both integrals over the weight at their end, which stays in range
        for span, rate, of_noise, first, last in drive:
            grown = math.exp(rate * span)
            energy_in = energy_in * grown + of_noise * span * (grown + 1) / 2
            energy_out = energy_out * grown + span * (first * grown + last) / 2
    if value is None or not division.touch:
        return None
    at = run.comm_points.at_s
    begin_ns = run.comm_points.start_ns  # times are those of the components
    times = (np.concatenate(division.points) + begin_ns) / 1e9
    covered = division.uncovered_at_ns is None
    bounded = covered and not set_points and run.end.status != "failed"
    return OutageFigures(
        bound=hinf.delay_lti.outage_bound(proved, times, np.concatenate(division.touch)),
        uncovered_s=division.uncovered_ns / 1e9,
        uncovered_at_s=None if division.uncovered_at_ns is None else at(division.uncovered_at_ns),
        value_ratio=value.ratio if bounded else None,
        weighted_gain=math.sqrt(energy_out / energy_in) if energy_in > 0 and covered else None,
    )


def _has_shorter_delays(system: DelaySystem, plant: Component) -> bool:
    """Whether a constant delay of the plant is not that of V; shorter ones are covered too."""
    delays = {plant.start_of(name) for name in plant.description.ports if _DELAY.match(name)}
    constant = {x.d for x in system.delays if not (x.any_age or x.feedback)}
    return bool(constant) and not constant >= {d for d in delays if d}


class _Division:
    """Time of a run, divided into intervals with the link up, outages, and what no proof covers.

    Attributes
    ----------
    alpha, beta : the rates of the proof.
    touch, points : by block, in which intervals the link is up, and where they begin and end [ns].
    uncovered_ns, uncovered_at_ns : how long, and since when, something was not covered [ns].
    """

    def __init__(
        self,
        proved: hinf.certificate.Outages,
        oldest: float,
        plant: str,
        collector: EventCollector | None,
    ) -> None:
        self.alpha, self.beta = float(proved.alpha), float(proved.beta)
        self._falls_back = bool(proved.fallback.any())
        self._oldest_ns = oldest * 1e9 * (1 + 1e-12)
        self.touch: list[NDArray[np.bool_]] = []
        self.points: list[Integers] = []
        self.uncovered_ns = 0
        self.uncovered_at_ns: int | None = None
        self._measured, self._deficit = False, 0.0
        self._episodes: list[Episodes] = []
        if collector is not None:
            words = "not covered: the control is held although older than designed for"
            control, over = f"{plant} control", "covered again"
            uncovered = collector.episodes("guarantee", control, words, over, level="error")
            words = "outage: the bound gamma is suspended"
            over = "the bound gamma is restored"
            self._episodes = [uncovered, collector.episodes("guarantee", plant, words, over)]

    def add(
        self, points: Integers, ages: Integers, u: Reals, first_control: Reals
    ) -> NDArray[np.bool_]:
        """Take intervals between points [ns]; return in which the link is up.

        ages : of the measurements in use at their ends [ns]; -1: of none.
        u : the control in them; first_control : K x(0).
        """
        used = ages >= 0
        touch = used & (ages <= self._oldest_ns)
        if not self._measured:
            early = (np.cumsum(used) == 0) & (points[1:] <= self._oldest_ns)
            same = np.abs(u - first_control) <= _CLOSE * np.abs(first_control).max(initial=0.0)
            touch |= early & same.all(axis=1)
            self._measured = bool(used.any())
        uncovered = ~(touch | ((u == 0.0).all(axis=1) & (not self._falls_back)))
        self.points.append(points[1:] if self.points else points)
        self.touch.append(touch)
        self.uncovered_ns += int(np.diff(points)[uncovered].sum())
        if self.uncovered_at_ns is None and uncovered.any():
            self.uncovered_at_ns = int(points[np.argmax(uncovered)])
        if self._episodes:
            states = uncovered, self._suspended(touch, np.diff(points))
            for episodes, there in zip(self._episodes, states, strict=True):
                episodes.add(points[:-1], there)
        return touch

    def _suspended(self, touch: NDArray[np.bool_], spans: Integers) -> NDArray[np.bool_]:
        """Return in which intervals the bound is suspended: until V is back below its bound."""
        deficits = []
        for there, h in zip(touch.tolist(), spans.tolist(), strict=True):
            rate = -2 * self.alpha if there else 2 * self.beta
            self._deficit = max(self._deficit + h / 1e9 * rate, 0.0)
            deficits.append(self._deficit)
        return ~touch | (np.array(deficits) > 0.0)


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
