"""Why a design cannot be had: the error that says which of the causes it is, and what to try.

What can be proved is (`cosim.hinf.refutation`), and the proof travels with the error. Only then
is it said that there is no solution: what a solver did not find was not found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from cosim.core import NotAchievableError
from cosim.hinf.assembly import Scalars
from cosim.hinf.conic import Solution
from cosim.hinf.problem import Answer, Problem
from cosim.hinf.refutation import refute
from cosim.hinf.solver_status import FAILED, OTHER_ROUTES, not_found
from cosim.hinf.stabilisability import unstabilisable_error
from cosim.models import DelaySystem

_OTHER_SCALARS = "another k1, k2 (start from k1 = -k2), a shorter delay, a smaller envelope"
_NOTHING = 1e-6
"""A least gamma below this, in units in which the system's numbers are near one, is zero."""


def hint_after(reason: str, usual: str) -> str:
    """What to try: other routes where the solver failed, else the usual."""
    return OTHER_ROUTES if FAILED in reason else usual


def no_feasible_gamma(
    system: DelaySystem, p: Scalars, solution: Solution, *, given: bool
) -> NotAchievableError:
    """No solution of the LMI for any gamma: proved, or not found, or the solver failed.

    given : the gain is given, and may be the reason.
    """
    cause = None if given else unstabilisable_error(system)
    if cause is not None:
        return cause
    bare = without_performance(system)
    proof = None if given else refute(bare, Problem(bare), p, None)
    if proof is not None:
        what = "the LMI has no solution for any gamma"
        reason = "proved: not even that of stability alone has one at these k1, k2 and delays"
    else:
        what = reason = not_found({solution.solver_message: 1})
        if FAILED not in reason:
            what = "no solution of the LMI was found for any gamma"
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
    """Gamma is below what the LMI reaches at these k1, k2; None if nothing reliable says so.

    Where that is not proved, the message says that gamma was not reached, not that it cannot be.
    """
    if gamma >= least.value * (1 - 1e-7):
        return None
    proof = None if given else refute(system, problem, p, gamma)
    if proof is None and not least.accurate:
        return None
    verb = "was not" if proof is None else "cannot be"
    return NotAchievableError(
        f"gamma = {gamma:g} {verb} reached with these k1, k2",
        where=system.name or None,
        expected=f"gamma >= {least.value:.6g}, the least that the solver finds at {_at(p)}",
        got=f"{gamma:g}" + ("" if proof is None else "; proved: the LMI has no solution there"),
        hint="another k1, k2: the least gamma depends on them strongly",
        certificate=proof,
    )


def is_zero_gamma(problem: Problem, least: Answer) -> bool:
    """Whether a least gamma is zero, as far as a solver can tell."""
    return least.value * problem.scaling.a**2 < _NOTHING


def no_least_gamma(system: DelaySystem, words: Mapping[str, int]) -> NotAchievableError:
    """The gain can be made as small as one likes: there is no least one to design for.

    words : how the solves ended that gave a gamma of zero; where one failed, it says nothing.
    """
    idle = not (system.C.any() or system.D1.any())
    idle = idle or not (system.D.any() or system.D1.any() or system.D2.any())
    failure = not_found(words)
    if FAILED in failure and not idle:
        return NotAchievableError(
            failure, where=system.name or None, expected="a least gamma", hint=OTHER_ROUTES
        )
    return NotAchievableError(
        "there is no gain from w to z to be made small: a matrix of it is zero"
        if idle
        else "there is no least gamma: the greater the gain K, the smaller the gain from w to z",
        where=system.name or None,
        expected="an output z that is moved by w"
        if idle
        else "an output z that weighs the control as well, by D2",
        got="a gamma that tends to zero",
        hint="leave C and D out for stability alone"
        if idle
        else "a gamma that is small enough, or a weight on u in D2",
    )


def not_certified(
    system: DelaySystem,
    p: Scalars,
    levels: Sequence[float | None],
    reason: str,
    *,
    given: bool,
) -> NotAchievableError:
    """No proof at any of the levels of gamma that were tried."""
    cause = None if given else unstabilisable_error(system)
    if cause is not None:
        return cause
    bounds = [level for level in levels if level is not None]
    proof: dict[str, Any] | None = None
    if not given:
        proof = refute(system, Problem(system), p, max(bounds, default=None))
    goal = f"gamma <= {max(bounds):.6g}" if bounds else "stability"
    return NotAchievableError(
        "no solution of the LMI could be certified"
        if proof is None
        else f"the LMI has no solution for {goal} with these k1, k2",
        where=system.name or None,
        expected=f"an exact proof of {goal} at {_at(p)}",
        got=reason if proof is None else "proved: the LMI has no solution there",
        hint=hint_after(reason, _OTHER_SCALARS),
        certificate=proof,
    )


def without_performance(system: DelaySystem) -> DelaySystem:
    """The system without w and z."""
    s = system
    return replace(s, C=s.C[:, :0], D=s.D[:0], D1=s.D1[:0, :0], D2=s.D2[:0])


def _at(p: Scalars) -> str:
    return f"k1 = {list(p.k1)}, k2 = {list(p.k2)}"
