"""The co-simulation loop (fixed or event-aligned points; Jacobi or Gauss-Seidel).

    for every communication point t_k:
        every component sends:    its outputs are written to row k
        every component receives: its inputs are read from the rows that the routes name
        every component steps from t_k to its next point, with constant inputs

(Jacobi; under Gauss-Seidel the components do this one after the other, and each receives the
outputs at t_{k+1} of those before it.) An engine (`cosim.master.engine`) executes a segment of
points at a time; after each the observers receive the new rows, and a run out of range ends. The
length of a segment depends on the machine; nothing that is recorded depends on it.

Under Jacobi, outputs computed from new inputs are exchanged at the next point only; this coupling
delay is reported apart from the delays of the links.
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
from cosim.master.run import Run, RunStatus, run_status_of
from cosim.master.system import System
from cosim.master.wiring import Wiring

_SEGMENT_S = 0.05
_LONGEST = 1 << 16


class _SegmentLength:
    """Chooses how many points a segment has, so that it takes about `_SEGMENT_S`."""

    def __init__(self) -> None:
        self.points = 1

    def took(self, points: int, seconds: float) -> None:
        """Adapt the length to the time that the last segment took."""
        share = min(8.0, _SEGMENT_S / max(seconds, 1e-9))
        self.points = max(1, min(_LONGEST, int(points * share)))


class Loop:
    """The execution of a run whose slaves are initialised.

    Attributes
    ----------
    complete : number of complete rows; the slaves are at the point after them.
    status, reason : as in `Run`; None while the run can continue.
    adjustments : overrides and biases, by column of the rows.
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
        """The time of the slaves [ns]."""
        return int(self._comm_points.points_ns[min(self.complete, self._comm_points.count - 1)])

    def run(
        self,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Callable[[], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue to an instant, by `most` points, or to the end; return whether `stop` ended it.

        `stop` is evaluated after every row; `pace` slows the run down to wall-clock time.
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
        """Continue from `complete` rows, to which slaves and wiring have been restored."""
        self.complete, self.adjustments = complete, dict(adjustments)
        self.status = self.reason = self._early_stop = None
        self.rebuild()

    def rebuild(self) -> None:
        """Build the engine anew for changed `adjustments` or `may_go_back`."""
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
        """Return the run so far; its status is "stopped" if it has not ended by itself."""
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
        # log lines of a step from a point out of range are dropped, like the step
        self._dispatch.deliver(
            self.complete, include_after_last=early_stop is None or early_stop.what != "range"
        )
        self._segment.took(last - first, time.perf_counter() - began)
        if self.status is not None:
            self._conclude()

    def _cross(self, k: int) -> EarlyStop | None:
        """Execute point k, at which the delay of a message is decided by what is sent there."""
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
