"""The result of a run: its status, its points and its signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError, InputError
from cosim.master.component_instance import ComponentInstance
from cosim.master.divergence import has_grown, origin_of, out_of_range
from cosim.master.engine import EngineChoice
from cosim.master.exchange import TOO_LARGE
from cosim.master.table import EarlyStop
from cosim.master.wiring import Wiring
from cosim.network import Delivery
from cosim.trace.outcome import Cause, CauseKind

RunStatus = Literal["finished", "stopped", "diverged", "failed"]
"""How a run ended; see `Run`."""

_CALLS = {"get": "Get", "set": "Set", "step": "DoStep", "end": "DoStep"}


@dataclass(frozen=True)
class Run:
    """The result of a run.

    Attributes
    ----------
    status : "finished" at the end; "stopped" by the user or a component; "diverged" when an
        output left its bound, or grew step by step until it was not finite; "failed" when a call
        of a component failed, or it gave infinity or NaN out of moderate values.
    reason : in words, None when finished.
    count : number of points reached.
    end_ns : the last of them [ns]; 0 without one.
    instances : the component instances; their rows up to `count` are valid if they were kept, else
        those from `oldest` on.
    engine : the engine that executed the run, and why it was chosen.
    statistics : of each packet link, up to the last point (`Delivery.statistics`).
    cause : why it did not reach its end; None when it did, or was stopped from outside.
    kept : whether all rows were kept.
    deliveries : of each packet link, as far as they are known; what was not kept is forgotten.
    """

    status: RunStatus
    reason: str | None
    count: int
    end_ns: int
    instances: tuple[ComponentInstance, ...]
    engine: EngineChoice
    statistics: Mapping[str, Mapping[str, float | None]]
    cause: Cause | None
    kept: bool
    deliveries: Mapping[str, Delivery]
    _points_ns: NDArray[np.int64]
    _wiring: Wiring | None = field(repr=False)

    @classmethod
    def of(
        cls,
        wiring: Wiring,
        count: int,
        status: RunStatus,
        reason: str | None,
        engine: EngineChoice,
        cause: Cause | None,
        *,
        kept: bool,
        whole: bool = True,
    ) -> Run:
        """Return the run of which the first `count` rows are complete.

        `whole` : the rows have the inputs, too; else `signal` copies them when it is asked.
        """
        points = wiring.comm_points
        if whole:
            wiring.make_whole(count)
        end_ns = int(points.points_ns[count - 1]) if count else 0
        # nothing is sent on a link of known delay in a run of a single point
        links = {name: one for name, one in points.links.items() if end_ns > 0 or one.is_live}
        # a run that diverges or fails at an instant of sending ends before that message
        statistics = {n: one.statistics(end_ns, broken_off=one.is_live) for n, one in links.items()}
        return cls(
            *(status, reason, count, end_ns, wiring.instances, engine, statistics, cause, kept),
            *(links, points.points_ns[:count], wiring),
        )

    def owned(self) -> Run:
        """Return the run with rows of its own; this one's are those of the session it is of."""
        if not self.kept or self._wiring is None:
            return self
        self._wiring.make_whole(self.count)
        rows = self._wiring.rows[: self.count].copy()
        instances = tuple(instance.with_rows(rows) for instance in self.instances)
        return replace(self, instances=instances, _points_ns=self._points_ns.copy(), _wiring=None)

    @property
    def points_ns(self) -> NDArray[np.int64]:
        """The points reached [ns], int64 (count,).

        Raises
        ------
        InputError : they were not kept.
        """
        self._check_kept()
        return self._points_ns

    def _check_kept(self) -> None:
        if not self.kept:
            raise InputError(
                "the rows of this run were not kept",
                where="Run",
                hint="Session(..., keep=True), or an observer, which receives all rows",
            )

    def signal(self, component: str, variable: str) -> NDArray[np.float64]:
        """Return the values of an output or connected input at the points reached, shape (k,).

        Raises
        ------
        InputError : no such component, a variable that the run did not exchange, or rows that were
            not kept.
        """
        names = {s.name: s for s in self.instances}
        instance = names.get(component)
        if instance is None:
            raise InputError.unknown("component", component, names)
        self._check_kept()
        count = self.count
        number, _ = instance.place(variable)
        if self._wiring is not None and number >= self._wiring.outputs:
            self._wiring.make_whole(count)
        values = instance.rows[:count, number]
        return values if instance.own_points.always else values[instance.own_points.last[:count]]


def run_status_of(wiring: Wiring, early_stop: EarlyStop) -> tuple[RunStatus, str, Cause]:
    """Return status, reason and cause of a run that stopped early."""
    seconds = wiring.comm_points.at_s(wiring.comm_points.points_ns[early_stop.k])
    if early_stop.what == "range":
        diverged, reason = out_of_range(wiring, early_stop.k, early_stop.instance)
        column, row = early_stop.instance, wiring.rows[early_stop.k]
        if not np.isfinite(row[column]):
            column = origin_of(wiring, early_stop.k, column)
        name = wiring.signal(column)
        kind: CauseKind = "diverged" if diverged else "not-finite"
        cause = Cause(kind, name.component, None, seconds, f"{name.variable} = {row[column]:g}")
        return ("diverged" if diverged else "failed"), reason, cause
    if early_stop.what == "loop":
        unsettled = _unsettled(wiring, early_stop)
        name = wiring.signal(early_stop.instance)
        cause = Cause("unsettled", name.component, None, seconds, unsettled.what)
        return "failed", unsettled.text(), cause
    instance = wiring.instances[early_stop.instance]
    slave, what = instance.slave, early_stop.what
    call = f"fmi{slave.description.version[0]}{_CALLS.get(what, '')}"
    if what in ("step", "end"):
        following = int(instance.own_points.following[early_stop.k])
        end = wiring.comm_points.at_s(wiring.comm_points.points_ns[following])
        try:
            reason = slave.early_end(seconds, end, early_stop.status) or ""
            return "stopped", reason, Cause("asked-to-end", instance.name, call, seconds, reason)
        except ComponentError as failure:
            error = failure
    elif early_stop.status == TOO_LARGE:
        error = ComponentError(
            f"an integer read at t = {seconds:g} s is too large to be exchanged",
            where=f"component {instance.name!r} ({slave.description.path.name})",
            expected="a magnitude of at most 2**53",
        )
    else:
        error = slave.refused(f"{what} at t = {seconds:g} s", early_stop.status)
    if error.kind is not None:  # the process of an isolated slave has ended
        return "failed", error.text(), Cause.of_error(error, seconds)
    overflow = "no longer finite" in (error.got or "")
    diverged = overflow and has_grown(instance, early_stop.complete)
    detail = error.what if error.got is None else f"{error.what}: {error.got}"
    kind = "diverged" if diverged else "not-finite" if overflow else "refused"
    cause = Cause(kind, instance.name, call, seconds, detail)
    return ("diverged" if diverged else "failed"), error.text(), cause


def _unsettled(wiring: Wiring, early_stop: EarlyStop) -> ComponentError:
    """Make the error of an algebraic loop whose values change with every pass."""
    signal = wiring.signal(early_stop.instance)
    loop = next(one for one in wiring.receiving.loops if signal.component in one)
    seconds = wiring.comm_points.at_s(wiring.comm_points.points_ns[early_stop.k])
    return ComponentError(
        f"an algebraic loop does not settle at t = {seconds:g} s",
        where=" -> ".join([*loop, loop[0]]),
        expected="values that stay within run.solve_tolerance of themselves before pass "
        "run.solve_limit",
        got=f"{signal} = {wiring.rows[early_stop.k, early_stop.instance]:g} in the last pass",
        hint="a loop with a gain of 1 or more never settles: cut it by a policy previous or a link "
        "with a delay; one with a gain just below 1 needs more passes",
    )
