"""Evaluate the assertions of a scenario on the rows of its run, as they come about."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.core import Findings
from cosim.master import Run, System
from cosim.scenario.binding import BoundExpression
from cosim.scenario.events import AssertionPart
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.run_events import EventCollector
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.scope import RunScope, ValueReader
from cosim.scenario.script import bind_condition, changed_by
from cosim.trace.outcome import AssertionResult, Result, RunEvent

_Truths = NDArray[np.bool_]
_Seconds = NDArray[np.float64]


class BoundAssertion(NamedTuple):
    """An assertion whose names are known in a system.

    condition : what is asserted; with `within`, what must hold.
    since : `when` of `within`, if there is one.
    """

    part: AssertionPart
    condition: BoundExpression
    since: BoundExpression | None


def bind_assertions(
    scenario: ScenarioPart, system: System, findings: Findings
) -> tuple[RunScope, list[BoundAssertion]]:
    """Check every assertion against the system; return those that are valid, and their scope.

    Raises
    ------
    InputError : an unknown name, or incompatible units.
    """
    scope = RunScope(system, changed_by(scenario))
    found = []
    for i, part in enumerate(scenario.assertions):
        bound = partial(bind_condition, scope, findings)
        since = None
        if part.within is not None:
            condition = bound(part.within.holds, "assertions", i, "within", "holds")
            if part.within.when is not None:
                since = bound(part.within.when, "assertions", i, "within", "when")
        elif part.always is not None:
            condition = bound(part.always, "assertions", i, "always")
        else:
            condition = bound(part.eventually or "", "assertions", i, "eventually")
        if condition is not None:
            found.append(BoundAssertion(part, condition, since))
    return scope, found


@measure
def assertion_results(
    run: MeasuredRun,
    scenario: ScenarioPart,
    system: System,
    findings: Findings,
    collector: EventCollector | None = None,
) -> Fold[tuple[AssertionResult, ...]]:
    """Measure the verdict on every assertion of a scenario, in its order.

    Each that fails, or is undecided, is an event for the collector. Errors as `bind_assertions`.
    """
    collector = collector or EventCollector(system.comm_schedule.start_ns)
    scope, bound = bind_assertions(scenario, system, findings)
    watched = [_Watched(each, scenario.run.end, collector, run, scope) for each in bound]
    while block := (yield):
        for each in watched:
            each.add(block.new, block.last)
    return tuple(each.result(run.end) for each in watched)


class _Watched:
    """One assertion during a run."""

    def __init__(
        self,
        bound: BoundAssertion,
        end: float,
        collector: EventCollector,
        run: MeasuredRun,
        scope: RunScope,
    ) -> None:
        self._part, self._condition, self._since = bound
        self._collector, self._announced = collector, False
        self._after = self._part.after or 0.0
        self._before = end if self._part.before is None else self._part.before
        self._verdict: _Verdict
        self._values: dict[str, float] = {}
        if self._part.within is not None:
            self._verdict = _Within(self._part.within.of)
        else:
            self._verdict = _First(always=self._part.always is not None)
        self._points = run.comm_points
        conditions = [self._condition, *([self._since] if self._since else [])]
        instances = list(run.instances.values())
        self._readers = [ValueReader(instances, scope, c.names) for c in conditions]
        run.reads_inputs |= any(reader.reads_inputs for reader in self._readers)

    def add(self, first: int, last: int) -> None:
        if self._verdict.at is not None:
            return
        points = self._points
        seconds = (points.points_ns[first:last] + points.start_ns) / 1e9
        inside = (seconds >= self._after) & (seconds <= self._before)
        values = self._readers[0].read(first, last)
        holds = _judged(self._condition, values, seconds.size)
        since = None
        if self._since is not None:
            since = _judged(self._since, self._readers[1].read(first, last), seconds.size)
        self._verdict.add(seconds, inside, holds, since)
        if self._verdict.known is not None:
            k = int(np.searchsorted(seconds, self._verdict.known))
            named = zip(self._condition.names, values, strict=True)
            self._values = {n: float(v[k]) for n, v in named if np.isfinite(v[k])}
            known_ns = round(self._verdict.known * 1e9) - points.start_ns
            self._announce(known_ns, self._result("fails", 0.0, whole=True))

    def result(self, run: Run) -> AssertionResult:
        last_s = self._points.at_s(run.end_ns) if run.count else -1.0
        whole = run.status == "finished" or last_s >= self._before
        # what a run did not reach fails if the run broke off, is open if it was stopped on purpose
        rest: Result = "undecided" if run.status == "stopped" else "fails"
        result = self._result(rest, last_s, whole=whole)
        self._announce(run.end_ns, result)
        return result

    def _result(self, rest: Result, last_s: float, *, whole: bool) -> AssertionResult:
        part, verdict = self._part, self._verdict.result(last_s, rest, whole=whole)
        return AssertionResult(
            words=part.words,
            name=part.name,
            result=verdict,
            expected=part.expected,
            at_s=self._verdict.at,
            values=self._values,
        )

    def _announce(self, time_ns: int, result: AssertionResult) -> None:
        """Make an event of an assertion that is decided, unless it holds as it should."""
        if self._announced or (result.as_expected and result.result == "holds"):
            return
        self._announced = True
        level = "info" if result.as_expected else "error"
        words = f"assertion {result.summary}" + (f": {result.words}" if result.name else "")
        subject = result.name or result.words
        self._collector.begun(RunEvent(time_ns, level, "assertion", subject, words))


def _judged(
    condition: BoundExpression, values: Sequence[NDArray[np.float64]], count: int
) -> _Truths:
    return np.broadcast_to(np.asarray(condition(values), dtype=bool), (count,))


class _Verdict(Protocol):
    """What is known of an assertion.

    at : the point that decided it [s]; None as long as none has.
    known : the point at which that was known [s]; a `within` fails later than where it began.
    """

    at: float | None
    known: float | None

    def add(
        self, seconds: _Seconds, inside: _Truths, holds: _Truths, since: _Truths | None
    ) -> None:
        """Take points: their times [s], whether they are in the window, and the conditions."""

    def result(self, last_s: float, rest: Result, *, whole: bool) -> Result:
        """Return the result of a run to `last_s`; `rest` of what it did not reach.

        `whole` : nothing of the window was left out.
        """


class _First(_Verdict):
    """`always` and `eventually`: the first point in the window that decides."""

    def __init__(self, *, always: bool) -> None:
        self._always = always
        self.at: float | None = None
        self.known: float | None = None

    def add(
        self, seconds: _Seconds, inside: _Truths, holds: _Truths, since: _Truths | None
    ) -> None:
        del since
        places = np.flatnonzero(inside & (~holds if self._always else holds))
        if places.size:
            self.at = self.known = float(seconds[places[0]])

    def result(self, last_s: float, rest: Result, *, whole: bool) -> Result:
        del last_s
        if self.at is not None:
            return "fails" if self._always else "holds"
        return ("holds" if self._always else "fails") if whole else rest


class _Within(_Verdict):
    """`within`: after each start the condition must become true in time.

    Only the earliest start that still waits is kept: if it is in time, so are those after it.
    """

    def __init__(self, of: float) -> None:
        self._of = of
        self._begun = self._was_true = False
        self._waiting: float | None = None
        self.at: float | None = None
        self.known: float | None = None

    def add(
        self, seconds: _Seconds, inside: _Truths, holds: _Truths, since: _Truths | None
    ) -> None:
        starts = seconds[self._starts(inside, since)]
        if self._waiting is not None:
            starts = np.concatenate(([self._waiting], starts))
        true_at = np.append(seconds[holds], np.inf)
        following = true_at[np.searchsorted(true_at, starts)]
        waiting = np.isinf(following)
        # what still waits at the last of the points is late if that is too late
        until = np.where(waiting, seconds[-1], following)
        due = starts + self._of * (1 + 1e-12)
        late = np.flatnonzero(until > due)
        if late.size:
            self.at = float(starts[late[0]])
            self.known = float(seconds[np.searchsorted(seconds, due[late[0]], side="right")])
        self._waiting = float(starts[waiting][0]) if waiting.any() else None

    def _starts(self, inside: _Truths, since: _Truths | None) -> NDArray[np.intp]:
        """Return the points from which it counts: `when` becomes true, or the first."""
        if since is None:
            found = np.flatnonzero(inside)[: not self._begun]
            self._begun |= bool(found.size)
            return found
        rising = since & ~np.concatenate(([self._was_true], since[:-1]))
        self._was_true = bool(since[-1])
        return np.flatnonzero(rising & inside)

    def result(self, last_s: float, rest: Result, *, whole: bool) -> Result:
        if self.at is None and self._waiting is not None:
            if not whole and self._waiting + self._of > last_s:
                return rest
            self.at = self._waiting
        return "holds" if self.at is None else "fails"
