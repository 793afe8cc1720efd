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
from cosim.master import ComponentInstance, Run
from cosim.models import inertia
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.limits import limits_of
from cosim.scenario.measure import Measure, after, own_points_in
from cosim.scenario.performance import reader_of

Reals = NDArray[np.float64]

_CLOSE = 1e-9
"""Relative to the sum of the magnitudes of the terms of a command."""


def complement(effects: Reals) -> Reals:
    """Return the projection on what no combination of columns explains; (m, m), symmetric."""
    size = len(effects)
    if not effects.size:
        return np.eye(size)
    return np.asarray(np.eye(size) - effects @ np.linalg.pinv(effects))


class FeedbackLaw(Measure[list[Departure]]):
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
        design: hinf.Design,
        problem: Problem,
        unrecorded: Collection[str] = (),
    ) -> None:
        self._loop, self._design, self._problem = loop, design, problem
        self._unrecorded = unrecorded
        self._instance: ComponentInstance | None = None
        self._found: Departure | None = None
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find what the controller is told, and what it commands."""
        instance = next((s for s in instances if s.name == self._loop.controller), None)
        if instance is None:
            return
        ports, start_of = instance.component.description.ports, instance.component.start_of
        states, commands = list(self._loop.states), list(self._loop.commands.values())
        system, n = self._design.system, len(self._design.system.A) - self._design.system.integrals
        xi = [f"xi[{i + 1}]" for i in range(system.integrals)]
        missing = [name for name in (*states, *commands, *xi) if name not in ports]
        if missing:
            place = f"{self._loop.controller}.{missing[0]}"
            self._found = Departure(place, "a variable of the controller", "there is none")
            return
        self._instance = instance
        inputs = np.flatnonzero(system.measured[:n])
        rows = np.array([system.A, *(x.A for x in system.delays)]).sum(axis=0)
        self._S: Reals = rows[n:][:, inputs]
        K = np.asarray(self._design.K, dtype=np.float64)
        self._K: Reals = np.hstack((K[:, inputs], K[:, n:]))
        if self._problem.vehicle is not None:
            self._K = np.array(inertia(self._problem.vehicle.parameters), dtype=float) @ self._K
        references = [name.replace("eta.", "reference.", 1) for name in states]
        self._with_reference = [
            j for j, name in enumerate(references) if name != states[j] and name in ports
        ]
        moved = [j for j in self._with_reference if references[j] in self._unrecorded]
        self._judged = complement(self._K[:, moved])
        self._x = reader_of(instance, states)
        self._reference = reader_of(instance, [references[j] for j in self._with_reference])
        self._out = reader_of(instance, [*commands, *xi])
        self._names = [*commands, *xi]
        limits = limits_of(ports)
        self._bounds = np.array(
            [start_of(limits[c], np.inf) if c in limits else np.inf for c in commands], float
        )
        self._period = round(float(start_of("sample_time", 0.0)) * 1e9)
        outputs = [ports[name] for name in commands]
        self._at_once = all(p.feedthrough and p.feedthrough_declared for p in outputs)
        self._begun: NDArray[np.int64] | None = None
        self._inputs: Reals | None = None
        self._outputs: Reals | None = None
        self._behind: Reals = np.full((1, len(states) + len(xi)), np.nan)

    def add(self, first: int, last: int) -> None:
        """Compare the commands at the points."""
        if self._instance is None:
            return
        error, out = self._x.read(first, last).copy(), self._out.read(first, last)
        error[:, self._with_reference] -= self._reference.read(first, last)
        own = own_points_in(self._instance, first, last)
        if not own.size or self._found is not None:
            return
        here = own - first
        error, out = error[here], out[here]
        points = self._instance.comm_points.points_ns[own]
        if self._at_once:
            self._compare(points, np.hstack((error, out[:, len(self._bounds) :])), out)
            return
        times = after(self._begun, points)
        k = len(self._bounds)
        inputs = after(self._inputs, np.hstack((error, out[:, k:])))
        outputs = after(self._outputs, out)
        self._begun, self._inputs, self._outputs = (
            points[-1:].copy(),
            inputs[-1:].copy(),
            outputs[-1:].copy(),
        )
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
        self._compare(ends, table[place], outputs[1:])
        self._integrate(ends, inputs[:-1], outputs, elapsed)

    def _compare(self, points: NDArray[np.int64], inputs: Reals, outputs: Reals) -> None:
        """Compare commands with what follows from what the controller was told."""
        wanted = np.clip(inputs @ self._K.T, -self._bounds, self._bounds)
        allowed = _CLOSE * (np.abs(inputs) @ np.abs(self._K).T)
        got = outputs[:, : len(self._bounds)]
        known = ~np.asarray(np.isnan(inputs)).any(axis=1, keepdims=True)
        apart = np.abs((wanted - got) @ self._judged)
        self._note(points, wanted, got, (apart > allowed) & known)

    def _integrate(
        self, points: NDArray[np.int64], inputs: Reals, outputs: Reals, elapsed: Reals
    ) -> None:
        """Compare integrals, where no command is at its limit."""
        k, n = len(self._bounds), self._S.shape[1]
        if not len(self._S) or self._found is not None:
            return
        change = elapsed[:, None] * (inputs[:, :n] @ self._S.T)
        before, now = outputs[:-1, k:], outputs[1:, k:]
        wanted = before + change
        allowed = _CLOSE * (np.abs(before) + np.abs(change) + 1e-12)
        free = (np.abs(outputs[1:, :k]) < self._bounds * (1 - 1e-12)).all(axis=1, keepdims=True)
        wrong = (np.abs(wanted - now) > allowed) & free
        blank = np.zeros((len(points), k))
        self._note(
            points,
            np.hstack((blank, wanted)),
            np.hstack((blank, now)),
            np.hstack((blank.astype(bool), wrong)),
        )

    def _note(
        self, points: NDArray[np.int64], wanted: Reals, got: Reals, wrong: NDArray[np.bool_]
    ) -> None:
        """Keep the first departure."""
        if self._found is not None or self._instance is None or not wrong.any():
            return
        k, j = (int(x) for x in np.argwhere(wrong)[0])
        at = self._instance.comm_points.at_s(int(points[k]))
        place = f"{self._loop.controller}.{self._names[j]}"
        expected = f"{wanted[k, j]:.9g}, by the K of the design"
        self._found = Departure(place, expected, f"{got[k, j]:.9g}", at)

    def result(self, run: Run) -> list[Departure]:
        """Return where the law was left."""
        del run
        return [] if self._found is None else [self._found]
