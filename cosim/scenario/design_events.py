"""Events of what the guarantee of a design assumes: young measurements, a state in the envelope."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.envelope import envelope_bounds
from cosim.scenario.gain import observes
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_events import Episodes, EventCollector


class DesignEvents:
    """Makes events of what a design assumes of a run: the age of measurements, the envelope."""

    def __init__(self, prepared: PreparedScenario, collector: EventCollector) -> None:
        self.collector = collector
        part, problem = prepared.loaded.scenario.design, prepared.problem
        designed = None if problem is None else problem.system.feedback_delay
        self._oldest_ns = np.inf if designed is None else designed * 1e9 * (1 + 1e-12)
        controller, plant = ("", "") if part is None else (part.controller, part.plant)
        links = prepared.loaded.scenario.links.values()
        self._watched = any(getattr(link, "greatest_age", 0.0) for link in links)
        self._seen = False
        words = f"the measurement in use is older than the {designed or 0:g} s designed for"
        if self._watched:
            words = f"no measurement within the {designed or 0:g} s designed for is in use"
        over = "the measurement in use is young enough again"
        self._age = collector.episodes("age", controller, words, over)
        self._axes: list[tuple[float, Episodes]] = []
        self._stamped: list[tuple[float, Episodes]] = []
        for each in prepared.design.measurements if observes(prepared.design) else ():
            words = f"the measurement in use is older than the {each.d:g} s designed for"
            of_one = collector.episodes("age", f"{controller}.{each.name}", words, over)
            self._stamped.append((each.d * 1e9 * (1 + 1e-12), of_one))
        for name, bound in () if problem is None else envelope_bounds(problem).values():
            words = f"outside the envelope of the proof: beyond {bound:g}"
            over = "inside the envelope again"
            axis = collector.episodes("envelope", f"{plant}.{name}", words, over)
            self._axes.append((bound, axis))

    def age(self, points_ns: NDArray[np.int64], ages_ns: NDArray[np.int64]) -> None:
        """Take the ages of the measurements in use."""
        late = ages_ns > self._oldest_ns
        if self._watched:  # a watchdog has put something else in its place
            late |= (ages_ns < 0) & (self._seen | np.logical_or.accumulate(ages_ns >= 0))
            self._seen |= bool((ages_ns >= 0).any())
        self._age.add(points_ns, late)

    def stamped(self, points_ns: NDArray[np.int64], ages_ns: NDArray[np.int64]) -> None:
        """Take the ages of the measurements that carry stamps, (n, measurements)."""
        for j, (oldest_ns, episodes) in enumerate(self._stamped):
            episodes.add(points_ns, ages_ns[:, j] > oldest_ns)

    def envelope(self, points_ns: NDArray[np.int64], magnitudes: NDArray[np.float64]) -> None:
        """Take the magnitudes of what the envelope bounds."""
        for j, (bound, episodes) in enumerate(self._axes):
            episodes.add(points_ns, ~(magnitudes[:, j] / bound <= 1.0))
