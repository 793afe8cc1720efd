"""Evaluate the assertions of a scenario on the rows of its run."""

from __future__ import annotations

from functools import partial

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
    """Evaluate every assertion; without a run, only check them against the system.

    Raises
    ------
    InputError : an unknown name, or incompatible units.
    """
    changed = [endpoint(target) for event in scenario.events for target in event.set]
    scope = RunScope(system, changed)
    end = scenario.run.end
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
    # what a run did not reach fails if the run broke off, is open if it was stopped on purpose
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
    """Return the points at which `within` starts to count: `when` becomes true, or the first."""
    if since is None:
        return np.flatnonzero(inside)[:1]
    rising = since & ~np.concatenate(([False], since[:-1]))
    return np.flatnonzero(rising & inside)


def _late(
    starts: NDArray[np.intp], holds: _Truths, seconds: NDArray[np.float64], of: float
) -> NDArray[np.intp]:
    """Return the starts after which the condition does not become true in time."""
    true_at = np.append(seconds[holds], np.inf)
    following = true_at[np.searchsorted(true_at, seconds[starts])]
    late: NDArray[np.intp] = starts[following > seconds[starts] + of * (1 + 1e-12)]
    return late
