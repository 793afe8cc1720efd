"""The law of a run, measured while it goes: from its rows and stamps alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from cosim.master import Run
from cosim.scenario.gain import Problem, observes
from cosim.scenario.guarantee.delivery_law import DeliveryLaw
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.feedback_law import FeedbackLaw
from cosim.scenario.guarantee.measured_noise import NoiseMeasure
from cosim.scenario.guarantee.observer_law import ObserverLaw, estimate_law
from cosim.scenario.guarantee.plant_law import plant_law
from cosim.scenario.guarantee.wiring import Wiring
from cosim.scenario.measure import Measure, Measures

if TYPE_CHECKING:
    from cosim.scenario.gain import AnyDesign

DELIVERED, PLANT, CONTROLLER = "values_delivered", "plant_law_held", "control_law_held"
MEASURED = "measurements_true"


class LawMeasures(Measures):
    """Measures the law of one run.

    Parameters
    ----------
    wiring : of the run, compared with the loop before.
    """

    def __init__(
        self,
        loop: DesignedLoop,
        wiring: Wiring,
        design: AnyDesign,
        problem: Problem,
    ) -> None:
        self._laws: list[tuple[str, Measure[list[Departure]]]] = [
            (DELIVERED, DeliveryLaw(wiring.feedback_connections())),
            (PLANT, plant_law(problem, loop.plant)),
        ]
        self._noise: NoiseMeasure | None = None
        if observes(design):
            self._laws.append((CONTROLLER, ObserverLaw(loop, design, problem)))
            self._laws.append((CONTROLLER, estimate_law(design, loop.controller)))
            self._noise = NoiseMeasure(loop.controller, loop.plant, design, problem.plant)
        else:
            self._laws.append((CONTROLLER, FeedbackLaw(loop, design, problem)))
        more = [] if self._noise is None else [self._noise]
        super().__init__([*(measure for _, measure in self._laws), *more])

    def departures(self, run: Run) -> Mapping[str, list[Departure]]:
        """Return at the end of the run by assumption where it left its law."""
        self.complete(run)
        found: dict[str, list[Departure]] = {}
        for name, measure in self._laws:
            found.setdefault(name, []).extend(measure.result(run))
        if self._noise is not None:
            found[MEASURED] = self._noise.result(run).departures
        return found
