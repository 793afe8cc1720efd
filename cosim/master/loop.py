"""The co-simulation loop (fixed or event-aligned points; Jacobi or Gauss-Seidel).

    for every communication point t_k:
        every component sends:    its outputs go into row k
        every component receives: its inputs are read off the rows that the links name
        every component steps from t_k to its next point, inputs held

(Jacobi; under Gauss-Seidel the components take turns, and each receives what those before it have
reached at t_{k+1}.) An engine (`cosim.master.engine`) carries that out, a stretch of points at a
time; between two stretches the observers look at the rows that are there, and a run that has left
its range ends. How long a stretch is depends on the machine; nothing that is recorded depends on
it.

The coupling delays what a component computes from its inputs until the next point; that
delay is the loop's own and is reported apart from the links'.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

from cosim.core import InputError
from cosim.master.engine import (
    Adjustment,
    EarlyStop,
    Engine,
    EngineChoice,
    Program,
    build_engine,
    fill_unreceived_inputs,
    make_program,
)
from cosim.master.observers import ObserverDispatch
from cosim.master.pacing import Pace
from cosim.master.run import Run, RunStatus
from cosim.master.run_status import run_status_of
from cosim.master.system import System
from cosim.master.wiring import Wiring

_SEGMENT_S = 0.05
_LONGEST = 1 << 16


class _SegmentLength:
    """How many points a stretch has: what takes about `_SEGMENT_S`."""

    def __init__(self) -> None:
        self.points = 1

    def took(self, points: int, seconds: float) -> None:
        """Take note of how long the last stretch took."""
        share = min(8.0, _SEGMENT_S / max(seconds, 1e-9))
        self.points = max(1, min(_LONGEST, int(points * share)))


class Loop:
    """A run on its way; its slaves are initialised.

    Attributes
    ----------
    complete : number of complete rows; every slave stands at the point after them.
    status, reason : as in `Run`; None as long as it goes on.
    adjustments : what outputs and inputs are adjusted by, by column of the rows.
    may_go_back : saved states of slaves may be restored.
    """

    def __init__(
        self, system: System, wiring: Wiring, dispatch: ObserverDispatch, choice: EngineChoice
    ) -> None:
        self._system, self._wiring, self._dispatch = system, wiring, dispatch
        self._choice = choice
        self._comm_points = wiring.comm_points
        self._delays = wiring.columns_of_delays(system)
        self._segment = _SegmentLength()
        self._early_stop: EarlyStop | None = None
        self._in_turns = system.algorithm == "gauss-seidel"
        self._program: Program
        self._engine: Engine
        self.complete = 0
        self.status: RunStatus | None = None
        self.reason: str | None = None
        self.adjustments: dict[int, Adjustment] = {}
        self.may_go_back = False
        self.rebuild()

    @property
    def time_ns(self) -> int:
        """Where the slaves stand [ns]."""
        return int(self._comm_points.points_ns[min(self.complete, self._comm_points.count - 1)])

    def run(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Callable[[], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Go on to an instant, or by so many points, or to the end; whether `stop` ended it.

        `stop` is looked at after every row; `pace` holds the run back to the clock on the wall.
        """
        points, begun = self._comm_points.points_ns, self.complete
        while self.status is None:
            first, last = self.complete, self._comm_points.count
            if until_ns is not None:
                last = int(np.searchsorted(points[:last], until_ns))
            if most is not None:
                last = min(last, begun + most)
            if first >= last:
                return False
            longest = 1 if stop is not None else self._segment.points
            if pace is not None:
                longest = min(longest, pace.wait(points[: self._comm_points.count], first))
            self._advance(first, min(last, first + longest))
            if pace is not None:
                pace.done(points[: self._comm_points.count], first, self.complete)
            if stop is not None and self.complete > first and stop():
                return True
        return False

    def go_back(self, complete: int, adjustments: Mapping[int, Adjustment]) -> None:
        """To where so many rows were complete; slaves and wiring are there already."""
        self.complete, self.adjustments = complete, dict(adjustments)
        self.status = self.reason = self._early_stop = None
        self.rebuild()

    def rebuild(self) -> None:
        """Take up what is adjusted, and whether states may be restored."""
        for instance in self._wiring.instances:
            for number, route in enumerate(instance.routes):
                if any(int(column) in self.adjustments for column in route.targets):
                    instance.copy_from(number, self.complete)
        self._program = make_program(
            self._system, self._wiring, self.adjustments, may_go_back=self.may_go_back
        )
        self._engine = build_engine(self._choice.name, self._program)
        self._dispatch.where = self._where

    def result(self) -> Run:
        """What has happened so far; "stopped" for a run that has not ended by itself."""
        points = self._comm_points.points_ns[: self.complete]
        return Run(
            self.status or "stopped",
            self.reason if self.status else f"stopped at t = {self.time_ns / 1e9:g} s",
            points,
            self._wiring.instances,
            self._choice,
            self._comm_points.schedules(int(points[-1]) if points.size else 0),
        )

    def _advance(self, first: int, last: int) -> None:
        began = time.perf_counter()
        horizon = self._comm_points.horizon
        if first == horizon:
            last = first + 1
            early_stop = self._cross(horizon)
        else:
            last = min(last, horizon)
            early_stop = self._engine.advance(first, last)
        if self.status is None:
            self.complete = last if early_stop is None else early_stop.complete
        if early_stop is not None:
            self._early_stop = early_stop
            self.status, self.reason = run_status_of(self._system, self._wiring, early_stop)
            if self._in_turns and early_stop.what != "range" and early_stop.complete > early_stop.k:
                fill_unreceived_inputs(self._program, self._wiring.instances, early_stop)
        elif self.status is None and self.complete > self._comm_points.final:
            self.status = "finished"
        # what is said in a step from a point out of range is void, like the step
        self._dispatch.deliver(
            self.complete, include_after_last=early_stop is None or early_stop.what != "range"
        )
        self._segment.took(last - first, time.perf_counter() - began)
        if self.status is not None:
            self._conclude()

    def _cross(self, k: int) -> EarlyStop | None:
        """A point at which a message is sent whose delay what is sent there decides."""
        early_stop = self._engine.send(k)
        if early_stop is not None:
            return early_stop
        row = self._wiring.rows[k]
        outside = ~(np.abs(row[: self._wiring.outputs]) <= self._system.divergence)
        if not outside.any():
            try:
                self._comm_points.resolve(k, row, self._delays)
            except InputError as error:
                self.status, self.reason = "failed", error.text()
                return None
        horizon = self._comm_points.horizon
        self._wiring.fill_rows(k, horizon)
        self._engine.update_routes(k, horizon)
        return self._engine.receive_and_step(k)

    def _conclude(self) -> None:
        points, early_stop = self._comm_points.points_ns, self._early_stop
        level = {"finished": "info", "stopped": "info"}.get(self.status or "", "error")
        last = early_stop.k if self.status == "failed" and early_stop else max(self.complete - 1, 0)
        place = (self.complete, int(points[last]))
        self._dispatch.where = lambda: place
        self._dispatch.note("master", level, self.reason or "the end is reached")

    def _where(self) -> tuple[int, int]:
        k, complete = self._engine.where()
        return k + complete, int(self._comm_points.points_ns[k])
