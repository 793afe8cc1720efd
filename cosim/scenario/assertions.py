"""Verdicts on what a scenario says must hold, from the rows of its run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import Run, System
from cosim.scenario.binding import BoundCondition
from cosim.scenario.events import AssertionPart
from cosim.scenario.matching import endpoint
from cosim.scenario.origin import Findings
from cosim.scenario.schema import Scenario
from cosim.scenario.scope import RunScope, values_over
from cosim.scenario.script import bind_condition
from cosim.trace import AssertionResult, Result

_Truths = NDArray[np.bool_]


def verdicts_of(
    scenario: Scenario, system: System, run: Run | None, findings: Findings
) -> tuple[AssertionResult, ...]:
    """A verdict on every assertion; without a run, they are only checked against the system.

    Raises
    ------
    InputError : a name that does not exist, or two units that do not go together.
    """
    changed = [endpoint(target) for event in scenario.events for target in event.set]
    scope = RunScope(system, changed)
    end = scenario.run.end
    found = []
    for i, part in enumerate(scenario.assertions):
        key = next(k for k in ("always", "eventually", "within") if getattr(part, k) is not None)
        since = None
        if part.within is not None:
            condition = bind_condition(
                part.within.holds, scope, findings, "assertions", i, key, "holds"
            )
            if part.within.when is not None:
                since = bind_condition(
                    part.within.when, scope, findings, "assertions", i, key, "when"
                )
        else:
            condition = bind_condition(getattr(part, key), scope, findings, "assertions", i, key)
        if run is not None and condition is not None:
            found.append(_verdict(part, condition, since, scope, run, end))
    return tuple(found)


def _verdict(
    part: AssertionPart,
    condition: BoundCondition,
    since: BoundCondition | None,
    scope: RunScope,
    run: Run,
    end: float,
) -> AssertionResult:
    seconds = run.points_ns / 1e9
    after, before = part.after or 0.0, end if part.before is None else part.before
    inside = (seconds >= after) & (seconds <= before)
    last_s = float(seconds[-1]) if seconds.size else -1.0
    whole = run.status == "finished" or last_s >= before
    # a run that broke off cannot keep a promise that it did not get to; one stopped on purpose
    # was not asked
    rest: Result = "undecided" if run.status == "stopped" else "fails"
    holds = _judged(condition, scope, run)
    if part.within is not None:
        starts = _starts(_judged(since, scope, run) if since else None, inside)
        late = _late(starts, holds, seconds, part.within.of)
        open_ones = late[seconds[late] + part.within.of > last_s] if not whole else late[:0]
        decided = np.setdiff1d(late, open_ones)
        result, at = _first(decided, seconds, "fails", "holds")
        if result == "holds" and open_ones.size:
            result, at = rest, None
    elif part.always is not None:
        result, at = _first(np.flatnonzero(inside & ~holds), seconds, "fails", "holds")
        if result == "holds" and not whole:
            result = rest
    else:
        result, at = _first(np.flatnonzero(inside & holds), seconds, "holds", "fails")
        if result == "fails" and not whole:
            result = rest
    return AssertionResult(part.words, part.name, result, part.expected, at)


def _first(
    places: NDArray[np.intp], seconds: NDArray[np.float64], there: Result, none: Result
) -> tuple[Result, float | None]:
    return (there, float(seconds[places[0]])) if places.size else (none, None)


def _judged(condition: BoundCondition, scope: RunScope, run: Run) -> _Truths:
    truths = np.asarray(condition(values_over(run, scope, condition.names)), dtype=bool)
    return np.broadcast_to(truths, run.points_ns.shape)


def _starts(since: _Truths | None, inside: _Truths) -> NDArray[np.intp]:
    """Points from which a `within` counts: where its condition becomes true, or the first."""
    if since is None:
        return np.flatnonzero(inside)[:1]
    rising = since & ~np.concatenate(([False], since[:-1]))
    return np.flatnonzero(rising & inside)


def _late(
    starts: NDArray[np.intp], holds: _Truths, seconds: NDArray[np.float64], of: float
) -> NDArray[np.intp]:
    """Starts after which it is not true in time."""
    true_at = np.append(seconds[holds], np.inf)
    following = true_at[np.searchsorted(true_at, seconds[starts])]
    late: NDArray[np.intp] = starts[following > seconds[starts] + of * (1 + 1e-12)]
    return late
