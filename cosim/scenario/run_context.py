"""A run with everything that its metrics depend on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import hinf
from cosim.master import Run, System
from cosim.scenario.envelope import envelope_bounds
from cosim.scenario.feedback_age import FeedbackAge, feedback_age
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.law_measures import MeasuredLaw
from cosim.scenario.guarantee.verdict import (
    LoopOfRun,
)
from cosim.scenario.run_measures import RunFigures, ZeroStateFigures
from cosim.scenario.schema import ScenarioPart

if TYPE_CHECKING:
    from cosim.hinf import Result


@dataclass(frozen=True)
class RunContext:
    """A run with everything its metrics depend on.

    figures : of the run.
    zero_state : figures of its zero-state run; None if that was not made.
    links : statistics of the packet links.
    worst_case : of the design; None if the scenario does not apply it.
    altered : what events changed but the traffic of links.
    compared : the loop of the run beside that of the design; None without a design.
    laws : what was measured of the law of the run, and of its zero-state run if that is another.
    """

    scenario: ScenarioPart
    problem: Problem | None
    design: Result | None
    system: System
    run: Run
    figures: RunFigures
    zero_state: ZeroStateFigures | None
    links: Mapping[str, Mapping[str, Any]]
    worst_case: hinf.delay_lti.WorstCase | None = None
    altered: Sequence[str] = ()
    compared: LoopOfRun | None = None
    laws: Mapping[str, MeasuredLaw] = field(default_factory=dict)

    @cached_property
    def known_age(self) -> FeedbackAge | None:
        """What the settings of the scenario say of the age of the feedback."""
        part = self.scenario.design
        if part is None:
            return None
        return feedback_age(self.system, part.plant, part.controller)

    @property
    def envelope_use(self) -> dict[str, float] | None:
        """The largest |value| / bound per axis, over the run and its zero-state run."""
        runs = [self.figures.largest, None if self.zero_state is None else self.zero_state.largest]
        if self.problem is None or not runs[0]:
            return None
        use = {}
        for axis, (name, bound) in envelope_bounds(self.problem).items():
            largest = max(found[name] for found in runs if found)
            use[axis] = largest / bound if np.isfinite(largest) else float("1e300")
        return use or None

    @property
    def age_s(self) -> float | None:
        """The greatest age of a measurement in use [s]; None if none came into use."""
        ages = self.figures.ages
        return None if ages is None else ages.greatest_ns / 1e9

    @property
    def gain(self) -> float | None:
        """The gain that the zero-state run measured."""
        return None if self.zero_state is None else self.zero_state.gain
