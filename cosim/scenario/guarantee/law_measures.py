"""The law of a run, measured while it goes: from its rows and stamps alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from cosim import hinf
from cosim.master import Endpoint, Run
from cosim.scenario.gain import Problem, observes
from cosim.scenario.guarantee.delivery_law import delivery_law
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.feedback_law import feedback_law
from cosim.scenario.guarantee.measured_noise import MeasuredNoise, measured_noise
from cosim.scenario.guarantee.motion import Motion, measured_motion
from cosim.scenario.guarantee.observer_law import estimate_law, observer_law
from cosim.scenario.guarantee.plant_law import plant_law
from cosim.scenario.guarantee.wiring import Wiring
from cosim.scenario.measure import Measure, Measures

if TYPE_CHECKING:
    from cosim.hinf import Result

DELIVERED, PLANT, CONTROLLER = "values_delivered", "plant_follows_law", "controller_follows_law"
MEASURED = "measurements_true"


class MeasuredLaw(NamedTuple):
    """What was measured of the law of a run.

    departures : by assumption.
    motion : of the state; None of a plant that is not known.
    noise_energy : of the measurements of an observer, if it is known.
    """

    departures: Mapping[str, list[Departure]]
    motion: Motion | None
    noise_energy: float | None


class LawMeasures(Measures):
    """Measures the law of one run.

    Parameters
    ----------
    wiring : of the run, compared with the loop before.
    changed : what events set: of inputs without a connection the rows do not show it.
    altered : whether events may override values on their way; without, what a route brings
        unaltered is not compared.

    Attributes
    ----------
    noise : of the measurements of an observer; None without one.
    """

    def __init__(
        self,
        loop: DesignedLoop,
        wiring: Wiring,
        design: Result,
        problem: Problem,
        changed: Iterable[Endpoint] = (),
        *,
        altered: bool = True,
    ) -> None:
        unrecorded = [end for end in changed if end not in wiring.connected]
        of_plant, of_controller = (
            {end.variable for end in unrecorded if end.component == name}
            for name in (loop.plant, loop.controller)
        )
        self._laws: list[tuple[str, Measure[list[Departure]]]] = [
            (DELIVERED, delivery_law(wiring.feedback_connections(), altered=altered)),
            (PLANT, plant_law(problem, loop.plant, of_plant)),
        ]
        system = hinf.problem.without_integrals(design.system)
        self._motion = measured_motion(loop, system, problem.plant)
        self._driven = bool(of_plant or of_controller)
        self.noise: Measure[MeasuredNoise] | None = None
        more: list[Measure[Any]] = [self._motion]
        if observes(design):
            law = observer_law(loop, design, problem, of_controller)
            self._laws += [(CONTROLLER, law), (CONTROLLER, estimate_law(loop, design))]
            self.noise = measured_noise(loop, design, problem.plant)
            more.append(self.noise)
        else:
            self._laws.append((CONTROLLER, feedback_law(loop, design, problem, of_controller)))
        super().__init__([*(law for _, law in self._laws), *more])

    def measured(self, run: Run) -> MeasuredLaw:
        """Return at the end of the run where it left its law, and how its state moved."""
        self.complete(run)
        found: dict[str, list[Departure]] = {}
        for name, measure in self._laws:
            found.setdefault(name, []).extend(measure.result(run))
        motion, energy = self._motion.result(run), None
        if self.noise is not None:
            energy, found[MEASURED] = self.noise.result(run)
        if motion is not None and (self._driven or energy):
            motion = replace(motion, driven=True)
        return MeasuredLaw(found, motion, energy)
