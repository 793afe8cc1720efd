"""The law of a state feedback: what a controller commands follows from what it was told.

    command = limited(M K (x - reference, xi)),   xi' = S (x - reference)

M maps controls to commands, xi are integrals that the controller keeps. A sampled controller takes
its inputs at the first of its points in a step that contains a sample instant, commands at the next
point, and holds the command. This is compared at every point, with the K of the design, whatever
FMU the controller is.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import ComponentInstance
from cosim.models import inertia
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.designed_loop import DesignedLoop, set_point_of
from cosim.scenario.guarantee.first_departure import (
    CLOSE,
    FirstDeparture,
    unexplained_by,
)
from cosim.scenario.limits import bounds_of
from cosim.scenario.measure import sample_period_ns
from cosim.scenario.performance import elements
from cosim.scenario.signal_reader import OwnRows

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class FeedbackLaw(FirstDeparture):
    """Where a controller left its law for the first time; empty if it never did.

    Parameters
    ----------
    loop : of the design.
    unrecorded : inputs of the controller that events set, and that no connection leads to: where
        they are set-points, commands may differ by what any set-point explains.
    """

    def __init__(
        self,
        loop: DesignedLoop,
        design: hinf.Result,
        problem: Problem,
        unrecorded: Collection[str] = (),
    ) -> None:
        system = design.system
        self._states, self._commands = list(loop.states), list(loop.commands.values())
        self._outputs = [*self._commands, *elements("xi", system.integrals)]
        super().__init__(loop.controller, [*self._states, *self._outputs])
        n = len(system.A) - system.integrals
        inputs = np.flatnonzero(system.measured[:n])
        self._S: Reals = np.array([system.A, *(x.A for x in system.delays)]).sum(axis=0)[n:, inputs]
        K = np.asarray(design.K, dtype=np.float64)
        self._K: Reals = np.hstack((K[:, inputs], K[:, n:]))
        if problem.vehicle is not None:
            self._K = np.array(inertia(problem.vehicle.parameters), dtype=float) @ self._K
        self._unrecorded = unrecorded

    def bind(self, instance: ComponentInstance) -> None:
        """Find what the controller is told, and what it commands."""
        ports = instance.component.description.ports
        set_points = ((j, set_point_of(state)) for j, state in enumerate(self._states))
        given = {j: name for j, name in set_points if name in ports}
        self._with_set_point = [*given]
        moved = [j for j, name in given.items() if name in self._unrecorded]
        self._judged = unexplained_by(self._K[:, moved])
        self._rows = OwnRows(instance, self._states, [*given.values()], self._outputs)
        self._bounds = bounds_of(instance, self._commands)
        self._period = sample_period_ns(instance.component)
        outputs = [ports[name] for name in self._commands]
        self._at_once = all(p.feedthrough and p.feedthrough_declared for p in outputs)
        self._behind: Reals = np.full((1, self._K.shape[1]), np.nan)

    def compare(self, first: int, last: int) -> None:
        """Compare the commands at the points."""
        times, (error, set_point, outputs) = self._rows.read(first, last)
        error[:, self._with_set_point] -= set_point
        inputs = np.hstack((error, outputs[:, len(self._bounds) :]))
        if self._at_once:
            self._compare_commands(times, inputs, outputs)
            return
        begins, ends = times[:-1], times[1:]
        if not begins.size:
            return
        place, elapsed = np.arange(1, times.size), (ends - begins) / 1e9
        if self._period > 0:
            # a step samples when it contains a multiple of the period
            taken = -(-ends // self._period) + (begins // -self._period)
            elapsed = taken * self._period / 1e9
            place = np.maximum.accumulate(np.where(taken > 0, place, 0))
        table = np.vstack((self._behind, inputs[:-1]))
        self._behind = table[place[-1:]].copy()
        self._compare_commands(ends, table[place], outputs[1:])
        self._compare_integrals(ends, inputs[:-1], outputs, elapsed)

    def _compare_commands(self, points: Integers, inputs: Reals, outputs: Reals) -> None:
        """Compare commands with what follows from what the controller was told."""
        wanted = np.clip(inputs @ self._K.T, -self._bounds, self._bounds)
        allowed = CLOSE * (np.abs(inputs) @ np.abs(self._K).T)
        got = outputs[:, : len(self._bounds)]
        known = ~np.asarray(np.isnan(inputs)).any(axis=1, keepdims=True)
        apart = np.abs((wanted - got) @ self._judged)
        self._note(points, wanted, got, (apart > allowed) & known, self._commands)

    def _compare_integrals(
        self, points: Integers, inputs: Reals, outputs: Reals, elapsed: Reals
    ) -> None:
        """Compare integrals, where no command is at its limit."""
        if not len(self._S):
            return
        k, n = len(self._bounds), self._S.shape[1]
        change = elapsed[:, None] * (inputs[:, :n] @ self._S.T)
        before, now = outputs[:-1, k:], outputs[1:, k:]
        allowed = CLOSE * (np.abs(before) + np.abs(change) + 1e-12)
        free = (np.abs(outputs[1:, :k]) < self._bounds * (1 - 1e-12)).all(axis=1, keepdims=True)
        wanted = before + change
        wrong = (np.abs(wanted - now) > allowed) & free
        self._note(points, wanted, now, wrong, self._outputs[k:])

    def _note(
        self,
        points: Integers,
        wanted: Reals,
        got: Reals,
        wrong: NDArray[np.bool_],
        names: list[str],
    ) -> None:
        if wrong.any():
            k, j = (int(x) for x in np.argwhere(wrong)[0])
            expected = f"{wanted[k, j]:.9g}, by the K of the design"
            self.depart(names[j], expected, f"{got[k, j]:.9g}", int(points[k]))
