"""The law of a state feedback: what a controller commands follows from what it was told.

    command = limited(M K (x - reference, xi)),   xi' = S (x - reference)

M maps controls to commands, xi are integrals that the controller keeps. A sampled controller takes
its inputs at the first of its points in a step that contains a sample instant, commands at the next
point, and holds the command. This is compared at every point, with the K of the design, whatever
FMU the controller is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.models import inertia
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop, set_point_of
from cosim.scenario.guarantee.first_departure import CLOSE, departed, lacking, unexplained_by
from cosim.scenario.limits import bounds_of
from cosim.scenario.measure import (
    Fold,
    MeasuredRun,
    held,
    measure,
    sample_period_ns,
    samples_in,
)
from cosim.scenario.performance import elements

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_Errors = tuple[Integers, Reals, Reals, NDArray[np.bool_], Sequence[str]]
"""Points [ns], what follows from the law, what was got, (n, k), where this is wrong; names."""


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
    instance = run.instances.get(loop.controller)
    if instance is None:
        return []
    law = _Law(loop, design, problem)
    if missing := lacking(instance, [*law.states, *law.outputs]):
        return missing
    ports = instance.component.description.ports
    set_points = ((j, set_point_of(state)) for j, state in enumerate(law.states))
    given = {j: name for j, name in set_points if name in ports}
    law.judged = unexplained_by(law.K[:, [j for j, name in given.items() if name in unrecorded]])
    law.bounds = bounds_of(instance, law.commands)
    reader = run.reader(loop.controller, [*law.states, *given.values(), *law.outputs])
    edges = np.cumsum([len(law.states), len(given), len(law.commands)])
    period_ns = sample_period_ns(instance.component)
    commanded = [ports[name] for name in law.commands]
    at_once = all(p.feedthrough and p.feedthrough_declared for p in commanded)
    behind: Reals = np.full((1, law.K.shape[1]), np.nan)
    while block := (yield):
        points, rows = reader.at_own(block.first, block.last)
        error, set_point, commands, integrals = np.split(rows, edges, axis=1)
        error[:, [*given]] -= set_point
        inputs = np.hstack((error, integrals))
        if at_once:
            errors = law.of_commands(points, inputs, commands)
        else:
            taken = samples_in(points, period_ns)
            elapsed = taken * period_ns / 1e9 if period_ns else np.diff(points) / 1e9
            used = held(behind, inputs[:-1], taken > 0)
            behind = np.concatenate((behind, used))[-1:]
            errors = chain(
                law.of_commands(points[1:], used, commands[1:]),
                law.of_integrals(points[1:], error[:-1], commands[1:], integrals, elapsed),
            )
        for times, wanted, got, wrong, names in errors:
            if wrong.any():
                k, j = (int(x) for x in np.argwhere(wrong)[0])
                expected = f"{wanted[k, j]:.9g}, by the K of the design"
                return [departed(instance, names[j], expected, f"{got[k, j]:.9g}", int(times[k]))]
    return []


class _Law:
    """The law of a state feedback, as matrices over the inputs of the controller.

    Attributes
    ----------
    states, commands, outputs : names of variables; outputs are the commands and the integrals.
    K : from states and integrals to commands.
    judged : the part of an error that no unrecorded set-point explains.
    bounds : of the commands.
    """

    judged: Reals
    bounds: Reals

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

    def of_commands(self, points: Integers, inputs: Reals, commands: Reals) -> Iterator[_Errors]:
        """Compare commands with what follows from what the controller was told."""
        wanted = np.clip(inputs @ self.K.T, -self.bounds, self.bounds)
        allowed = CLOSE * (np.abs(inputs) @ np.abs(self.K).T)
        known = ~np.asarray(np.isnan(inputs)).any(axis=1, keepdims=True)
        apart = np.abs((wanted - commands) @ self.judged)
        yield points, wanted, commands, (apart > allowed) & known, self.commands

    def of_integrals(
        self, points: Integers, error: Reals, commands: Reals, integrals: Reals, elapsed: Reals
    ) -> Iterator[_Errors]:
        """Compare integrals, where no command is at its limit."""
        if len(self._S):
            change = elapsed[:, None] * (error @ self._S.T)
            before, now = integrals[:-1], integrals[1:]
            allowed = CLOSE * (np.abs(before) + np.abs(change) + 1e-12)
            free = (np.abs(commands) < self.bounds * (1 - 1e-12)).all(axis=1, keepdims=True)
            wrong = (np.abs(before + change - now) > allowed) & free
            yield points, before + change, now, wrong, self.outputs[len(self.commands) :]
