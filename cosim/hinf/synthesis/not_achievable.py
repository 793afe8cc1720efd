"""Errors for designs that cannot be achieved: the cause, and what to try.

Where possible the cause is proved (`cosim.hinf.lmi.refutation`), with the proof in the error. Only
then does a message say that there is no solution; otherwise that none was found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.core import NotAchievableError
from cosim.hinf.lmi import (
    FAILED,
    OTHER_ROUTES,
    Answer,
    Problem,
    Solution,
    not_found,
    refute,
    without_performance,
)
from cosim.hinf.synthesis.stabilisability import NoGainError, unstabilisable_error
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem

_OTHER_SCALARS = "another k1, k2 (start from k1 = -k2), or none, so that they are searched"
NO_ROUTE_LEFT = (
    "a larger gamma, a shorter delay, weaker constraints, or other units for states, inputs and "
    "time"
)
"""What to try after every route, where nothing is known of what was asked."""
_NOTHING = 1e-6  # a least gamma below this, in inner units, counts as zero


def none_succeeded(
    errors: Sequence[tuple[str, NotAchievableError]], hint: str = NO_ROUTE_LEFT
) -> NotAchievableError:
    """Return the error of the first route, with the names of the others and the first refutation.

    errors : one or more, each with the name of its route.
    hint : what to try where there are several.
    """
    name, first = errors[0]
    if len(errors) == 1:
        return first
    others = [
        other
        # how near another route came
        + (f" ({error.got})" if "least that was found" in str(error.got) else "")
        for other, error in errors[1:]
    ]
    proofs = [error.certificate for _, error in errors if error.certificate is not None]
    return NotAchievableError(
        first.what,
        where=first.where,
        expected=first.expected,
        got=f"no proof by {name} ({first.got or first.what}), nor by {', '.join(others)}",
        hint=hint,
        certificate=next(iter(proofs), None),
    )


def hint_after(reason: str, usual: str) -> str:
    """Return what to try: other routes where the solver failed, otherwise `usual`."""
    return OTHER_ROUTES if FAILED in reason else usual


def no_feasible_gamma(
    system: DelaySystem, p: Scalars, solution: Solution, *, given: bool
) -> NotAchievableError:
    """Return the error for an LMI without a solution for any gamma: proved, or not found.

    given : whether the gain is given, and may be the reason.
    """
    cause = None if given else unstabilisable_error(system)
    if cause is not None:
        return cause
    bare = without_performance(system)
    proof = None if given else refute(bare, Problem(bare), p, None)
    if proof is not None:
        what = "the LMI of Theorem 2 has no solution for any gamma"
        reason = "proved: the LMI of stability alone has none at these delays"
    else:
        what = reason = not_found({solution.solver_message: 1})
        if FAILED not in reason:
            what = "no solution of the LMI of Theorem 2 was found for any gamma"
    return NotAchievableError(
        what,
        where=system.name or None,
        expected=f"a feasible LMI at {_at(p)}",
        got=reason
        if reason != what
        else f"status {solution.solver_message}, and no proof either way",
        hint=hint_after(reason, _OTHER_SCALARS),
        certificate=proof,
    )


def gamma_below_least(
    system: DelaySystem, problem: Problem, p: Scalars, gamma: float, least: Answer, *, given: bool
) -> NotAchievableError | None:
    """Return the error for a gamma below the least at these k1, k2; None if it may be feasible.

    Without a proof the message says that gamma was not reached, not that it cannot be.
    """
    if gamma >= least.value * (1 - 1e-7):
        return None
    proof = None if given else refute(system, problem, p, gamma)
    if proof is None and not least.accurate:
        return None
    verb = "was not" if proof is None else "cannot be"
    return NotAchievableError(
        f"gamma = {gamma:g} {verb} reached by Theorem 2",
        where=system.name or None,
        expected=f"gamma >= {least.value:.6g}, the least that the solver finds at {_at(p)}",
        got=f"gamma = {gamma:g}, below it"
        + ("" if proof is None else "; proved: the LMI has no solution there"),
        hint="another k1, k2: the least gamma depends on them strongly",
        certificate=proof,
    )


def is_zero_gamma(problem: Problem, least: Answer) -> bool:
    """Whether a least gamma is zero, as far as a solver can tell."""
    return least.value * problem.scaling.a**2 < _NOTHING


def no_least_gamma(system: DelaySystem, words: Mapping[str, int]) -> NotAchievableError:
    """Return the error for a gain from w to z that can be made arbitrarily small.

    words : how often each status ended the solves that gave a gamma of zero.
    """
    idle = not (system.C.any() or system.D1.any())
    idle = idle or not (system.D.any() or system.D1.any() or system.D2.any())
    failure = not_found(words)
    if FAILED in failure and not idle:
        return NotAchievableError(
            failure, where=system.name or None, expected="a least gamma", hint=OTHER_ROUTES
        )
    if idle:
        what = "there is no gain from w to z to minimise: one of its matrices is zero"
        expected = "an output z that depends on w"
        hint = "leave C and D out for stability alone"
    else:
        what = "there is no least gamma: the greater the gain K, the smaller the gain from w to z"
        expected = "an output z that weighs the control as well, by D2"
        hint = "a gamma that is small enough, or a weight on u in D2"
    where, got = system.name or None, "a gamma that tends to zero"
    return NoGainError(what, where=where, expected=expected, got=got, hint=hint)


def not_certified(
    system: DelaySystem,
    p: Scalars,
    levels: Sequence[float | None],
    reason: str,
    *,
    given: bool,
) -> NotAchievableError:
    """Return the error for a design without a proof at any level of gamma that was tried."""
    cause = None if given else unstabilisable_error(system)
    if cause is not None:
        return cause
    bounds = [level for level in levels if level is not None]
    proof: dict[str, Any] | None = None
    if not given:
        proof = refute(system, Problem(system), p, max(bounds, default=None))
    goal = f"gamma <= {max(bounds):.6g}" if bounds else "stability"
    return NotAchievableError(
        "no solution of the LMI of Theorem 2 could be certified"
        if proof is None
        else f"the LMI of Theorem 2 has no solution for {goal}",
        where=system.name or None,
        expected=f"an exact proof of {goal} at {_at(p)}",
        got=reason if proof is None else "proved: the LMI has no solution there",
        hint=hint_after(reason, _OTHER_SCALARS),
        certificate=proof,
    )


def _at(p: Scalars) -> str:
    return f"k1 = {list(p.k1)}, k2 = {list(p.k2)}"
