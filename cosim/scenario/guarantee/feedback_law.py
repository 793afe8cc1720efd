"""The law of a state feedback: what a controller commands follows from what it was told.

    command = limited(M K (x - reference, xi)),   xi' = S (x - reference)

M maps controls to commands, xi are integrals that the controller keeps. A sampled controller takes
its inputs at the first of its points in a step that contains a sample instant, commands at the next
point, and holds the command. This is compared at every point, with the K of the design, whatever
FMU the controller is.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import ComponentInstance
from cosim.models import inertia
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop, set_point_of
from cosim.scenario.guarantee.first_departure import (
    CLOSE,
    first_departed,
    lacking,
    unexplained_by,
)
from cosim.scenario.limits import bounds_of
from cosim.scenario.measure import (
    Fold,
    MeasuredRun,
    hold,
    measure,
    sample_period_ns,
    samples_in,
)
from cosim.scenario.performance import elements

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_BY_K = "by the K of the design"


@measure
def feedback_law(
    run: MeasuredRun,
    loop: DesignedLoop,
    design: hinf.Result,
    problem: Problem,
    unrecorded: Collection[str] = (),
) -> Fold[list[Departure]]:
    """Measure where a controller left its law for the first time; empty if it never did.

    Parameters
    ----------
    loop : of the design.
    unrecorded : inputs of the controller that events set, and that no connection leads to: where
        they are set-points, commands may differ by what any set-point explains.
    """
    instance, law = run.instances[loop.controller], _Law(loop, design, problem)
    if missing := lacking(instance, [*law.states, *law.outputs]):
        return missing
    ports = instance.component.description.ports
    set_points = ((j, set_point_of(state)) for j, state in enumerate(law.states))
    given = {j: name for j, name in set_points if name in ports}
    law.bind(instance, [j for j, name in given.items() if name in unrecorded])
    reader = run.reader(loop.controller, [*law.states, *given.values(), *law.outputs])
    edges = np.cumsum([len(law.states), len(given), len(law.commands)])
    period_ns = sample_period_ns(instance.component)
    commanded = [ports[name] for name in law.commands]
    at_once = all(p.feedthrough and p.feedthrough_declared for p in commanded)
    behind: Reals = np.full((1, law.K.shape[1]), np.nan)
    while block := (yield):
        points, rows = reader.at_own(block)
        error, set_point, commands, integrals = np.split(rows, edges, axis=1)
        error[:, [*given]] -= set_point
        inputs = np.hstack((error, integrals))
        if at_once:
            left = law.of_commands(points, inputs, commands)
        else:
            taken, ends, commands = samples_in(points, period_ns), points[1:], commands[1:]
            elapsed = taken * period_ns / 1e9 if period_ns else np.diff(points) / 1e9
            used = hold(behind, inputs[:-1], taken > 0)
            behind = np.concatenate((behind, used))[-1:]
            left = law.of_commands(ends, used, commands) or law.of_integrals(
                ends, error[:-1], commands, integrals, elapsed
            )
        if left:
            return left
    return []


class _Law:
    """The law of a state feedback, as matrices over the inputs of the controller.

    Attributes
    ----------
    states, commands, outputs : names of variables; outputs are the commands and the integrals.
    K : from states and integrals to commands.
    """

    def __init__(self, loop: DesignedLoop, design: hinf.Result, problem: Problem) -> None:
        system = design.system
        self.states, self.commands = list(loop.states), list(loop.commands.values())
        self.outputs = [*self.commands, *elements("xi", system.integrals)]
        n = len(system.A) - system.integrals
        inputs = np.flatnonzero(system.measured[:n])
        self._S: Reals = np.array([system.A, *(x.A for x in system.delays)]).sum(axis=0)[n:, inputs]
        K = np.asarray(design.K, dtype=np.float64)
        self.K: Reals = np.hstack((K[:, inputs], K[:, n:]))
        if problem.vehicle is not None:
            self.K = np.array(inertia(problem.vehicle.parameters), dtype=float) @ self.K

    def bind(self, instance: ComponentInstance, moved: Sequence[int]) -> None:
        """Find the bounds of the commands, and what unrecorded set-points do not explain."""
        self._instance, self._bounds = instance, bounds_of(instance, self.commands)
        self._judged = unexplained_by(self.K[:, moved])

    def of_commands(self, points: Integers, inputs: Reals, commands: Reals) -> list[Departure]:
        """Compare commands with what follows from what the controller was told."""
        wanted = np.clip(inputs @ self.K.T, -self._bounds, self._bounds)
        allowed = CLOSE * (np.abs(inputs) @ np.abs(self.K).T)
        known = ~np.asarray(np.isnan(inputs)).any(axis=1, keepdims=True)
        wrong = (np.abs((wanted - commands) @ self._judged) > allowed) & known
        return first_departed(
            self._instance, self.commands, points, (wanted, commands), wrong, _BY_K
        )

    def of_integrals(
        self, points: Integers, error: Reals, commands: Reals, integrals: Reals, elapsed: Reals
    ) -> list[Departure]:
        """Compare integrals, where no command is at its limit."""
        if not len(self._S):
            return []
        change = elapsed[:, None] * (error @ self._S.T)
        before, now = integrals[:-1], integrals[1:]
        wanted = before + change
        allowed = CLOSE * (np.abs(before) + np.abs(change) + 1e-12)
        free = (np.abs(commands) < self._bounds * (1 - 1e-12)).all(axis=1, keepdims=True)
        wrong = (np.abs(wanted - now) > allowed) & free
        names = self.outputs[len(self.commands) :]
        return first_departed(self._instance, names, points, (wanted, now), wrong, _BY_K)
