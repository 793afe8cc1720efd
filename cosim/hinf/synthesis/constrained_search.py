"""Search for the gain of least gamma that meets design constraints.

The LMI with all constraints (`cosim.hinf.lmi.constrained_problem`) shares X and is conservative.
The constraints are therefore relaxed step by step towards the design without them, as long as
the original ones can be proved: each step is a design with its own proofs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from cosim.core import NotAchievableError
from cosim.hinf.certificate import GainLimit, Guarantees, norm_above
from cosim.hinf.exact import exact
from cosim.hinf.lmi import (
    FAILED,
    OTHER_UNITS,
    Answer,
    ConstrainedProblem,
    not_found,
    proved_peak_control,
    solver_words,
)
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.synthesis import theorem_2_gamma
from cosim.hinf.synthesis.decay_search import corner_scalars, proved_decay
from cosim.hinf.synthesis.level_search import Level, best_level, level_of
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.search import starts
from cosim.hinf.synthesis.theorem_2_gamma import checked_scalars
from cosim.hinf.theorems import Scalars
from cosim.models import DelaySystem

_SLACK = 1e-3  # share by which the solver stays inside a limit: K is rounded afterwards
_STARTS = 4  # pairs k1, k2 tried with the constraints in full
_NEARLY = 0.85  # first strength, without a better guess
_STEPS = 2  # designs with relaxed constraints


def prove_constraints(
    proved: Result, design_constraints: DesignConstraints, at: Scalars | None
) -> tuple[Guarantees | None, str]:
    """Prove the design constraints for the gain as it is; or return None and why.

    at : k1, k2 to begin with; any may do, since the gain is given. None where neither a decay nor
        a peak is asked for.
    """
    system, K = proved.system, proved.K
    scalars = [] if at is None else starts(at)
    made: dict[str, Any] = {}
    if design_constraints.gain_limit is not None:
        limit = GainLimit(exact(min(norm_above(K), design_constraints.gain_limit)))
        if limit.failure(system, K) is not None:
            return None, f"gain_limit: the norm of K is {norm_above(K):.6g}"
        made["gain_limit"] = limit
    damping = design_constraints.damping_to_prove
    if damping is not None:
        failed = damping.failure(system, K)
        if failed is not None:
            return None, f"damping: {failed}"
        made["damping"] = damping
    if design_constraints.peak_control is not None:
        peak, reason = proved_peak_control(system, K, design_constraints, scalars)
        if peak is None:
            return None, f"peak_control: {reason}"
        made["peak_control"] = peak
    if design_constraints.decay is not None:
        decay, reason = proved_decay(system, K, design_constraints.decay, scalars[0])
        if decay is None:
            return None, f"decay: {reason}"
        made["decay"] = decay
    return Guarantees(**made), ""


def constrained(
    proved: Result, design_constraints: DesignConstraints, at: Scalars | None = None
) -> Result:
    """Return a design with the constraints proved for its gain; `at` as in `prove_constraints`.

    Raises
    ------
    NotAchievableError : they are not, and why.
    """
    guarantees, reason = prove_constraints(proved, design_constraints, at)
    if guarantees is None:
        raise NotAchievableError(
            "the design constraints could not be proved for this gain",
            where=proved.system.name or None,
            expected=describe_constraints(design_constraints),
            got=reason,
        )
    return with_guarantees(proved, guarantees)


def with_guarantees(proved: Result, guarantees: Guarantees) -> Result:
    """Return the design with the guarantees in its claim, their proofs in its certificate."""
    certificate = guarantees.beside(proved.certificate)
    return replace(proved, guarantees=guarantees, certificate=certificate)


def scalars_of(proved: Result) -> Scalars:
    """Return k1, k2 and the delays of a design by Theorem 2."""
    return checked_scalars(proved.system, proved.k1, proved.k2)


class ConstrainedSearch:
    """The search for a gain that meets the constraints, from a design that does not."""

    def __init__(
        self,
        start: Scalars,
        system: DelaySystem,
        design_constraints: DesignConstraints,
        gamma: float | None,
        *,
        search: bool,
    ) -> None:
        self._system, self._design_constraints, self._gamma = system, design_constraints, gamma
        self._search, self._start = search, start
        self._level: Level | None = None
        self._free: dict[str, Any] = {}

    def best(self, plain: Result | None) -> Result:
        """Design with the constraints in full, then relax them towards `plain` while provable."""
        best, reason = None, ""
        tried = starts(self._start)[:_STARTS]
        for p in tried:
            best, reason = self._at(1.0, p)
            if best is not None:
                self._start = p
                break
        if best is None:
            raise NotAchievableError(
                "no gain was found that meets the design constraints",
                where=self._system.name or None,
                expected=describe_constraints(self._design_constraints)
                + ("" if self._gamma is None else f", and gamma = {self._gamma:g}"),
                got=f"none of {len(tried)} starts led to a proof; of the last, {reason}",
                hint="weaker constraints"
                + ("" if self._gamma is None else ", a larger gamma")
                + (f", or {OTHER_UNITS}" if FAILED in reason else ""),
            )
        if self._gamma is not None or best.gamma is None or plain is None:
            return best
        self._free = self._of_itself(plain)
        low, high, strength = 0.0, 1.0, self._guess(best)
        for _ in range(_STEPS):
            if not low < strength < high:
                strength = (low + high) / 2
            other, _ = self._at(strength, self._start)
            if other is not None and other.gamma is not None and other.gamma < best.gamma:
                best, high = other, strength
            else:
                low = strength
            strength = (low + high) / 2
        return best

    def _at(self, strength: float, p: Scalars) -> tuple[Result | None, str]:
        """Design with the constraints at this strength; None and why, unless all are proved."""
        with solver_words() as solve_count:
            problem = self._problem(self._eased(strength), p)
        if problem is None:
            return None, not_found(solve_count)
        try:
            designed = theorem_2_gamma.design(
                self._system,
                p.k1,
                p.k2,
                gamma=self._gamma,
                problem=problem,
                search=self._search and problem.has_gamma,
            )
        except NotAchievableError as error:
            return None, error.what if FAILED in error.what else f"{error.what}: {error.got}"
        guarantees, reason = prove_constraints(
            designed, self._design_constraints, scalars_of(designed)
        )
        return (None, reason) if guarantees is None else (with_guarantees(designed, guarantees), "")

    def _of_itself(self, plain: Result) -> dict[str, Any]:
        """Return the limits above which the bounds of the LMI do not affect the first design."""
        d = self._design_constraints
        free: dict[str, Any] = {}
        X = np.array(
            [[float(Fraction(x)) for x in row] for row in plain.certificate["variables"]["X"]]
        )
        KXK = plain.K @ X @ plain.K.T
        if d.gain_limit is not None:
            least = float(np.linalg.eigvalsh(X)[0])
            free["gain_limit"] = math.sqrt(float(np.linalg.norm(KXK, 2)) / least)
        if d.peak_control is not None:
            level = level_of(X, plain.gamma, d)
            free["peak_control"] = tuple(math.sqrt(level * float(x)) for x in np.diag(KXK))
        return free

    def _eased(self, strength: float) -> DesignConstraints:
        """Return the constraints, relaxed towards the first design; in full at strength 1."""
        d, inside = self._design_constraints, 1 - _SLACK
        changes: dict[str, Any] = {}
        if d.decay is not None:
            changes["decay"] = d.decay * (1 + _SLACK) * strength
        if d.gain_limit is not None:
            free = self._free.get("gain_limit", d.gain_limit)
            changes["gain_limit"] = inside * _between(free, d.gain_limit, strength)
        if d.peak_control is not None:
            peak = self._free.get("peak_control", d.peak_control)
            changes["peak_control"] = tuple(
                inside * _between(free, limit, strength)
                for limit, free in zip(d.peak_control, peak, strict=True)
            )
        return replace(d, **changes)

    def _guess(self, designed: Result) -> float:
        """Estimate the strength at which the proved bounds would just meet the limits."""
        d, more = self._design_constraints, designed.guarantees
        pairs = []
        if d.gain_limit is not None and more.gain_limit is not None:
            pairs.append((d.gain_limit, float(more.gain_limit.bound), self._free["gain_limit"]))
        if d.peak_control is not None and more.peak_control is not None:
            has = [float(value) for value in more.peak_control.bounds]
            pairs += zip(d.peak_control, has, self._free["peak_control"], strict=True)
        shares = [
            1 - math.log(limit / has) / math.log(free / limit)
            for limit, has, free in pairs
            if free > limit > has > 0
        ]
        return max(shares, default=_NEARLY)

    def _widest(
        self, design_constraints: DesignConstraints, p: Scalars
    ) -> ConstrainedProblem | None:
        """Return the LMI without the levels, its corners at the k1, k2 of least gamma."""
        if design_constraints.decay is None:
            return ConstrainedProblem(self._system, design_constraints, p)
        likely = corner_scalars(self._system, design_constraints.decay, p)
        problems = [ConstrainedProblem(self._system, design_constraints, at) for at in likely]
        if len(problems) < 2 or not problems[0].has_gamma:
            return problems[0] if problems else None
        asked = [problem.least_gamma(p) for problem in problems]
        values = [x.value if isinstance(x, Answer) else math.inf for x in asked]
        return problems[values.index(min(values))]

    def _problem(
        self, design_constraints: DesignConstraints, p: Scalars
    ) -> ConstrainedProblem | None:
        """Return the LMI with V kept at the level of least gamma; None: infeasible at all."""
        problem = self._widest(design_constraints, p)
        if problem is None or design_constraints.peak_control is None:
            return problem
        # the level is searched without the corners of a decay, which cost most
        bare = problem
        if design_constraints.decay is not None:
            bare = ConstrainedProblem(self._system, replace(design_constraints, decay=None), p)
        level = best_level(bare, p, self._design_constraints, self._level)
        if level is None:
            return None
        self._level = level
        level.apply_to(problem)
        return problem


def _between(free: float, limit: float, strength: float) -> float:
    """Return the limit at strength 1, and where it has no effect at 0."""
    return float(limit * max(free / limit, 1.0) ** (1.0 - strength))


def describe_constraints(design_constraints: DesignConstraints) -> str:
    """Return the constraints as text for a message."""
    d = design_constraints
    parts = []
    if d.decay is not None:
        parts.append(f"decay at {d.decay:g} 1/s")
    if d.damping is not None:
        parts.append(f"a damping ratio of {d.damping:g} where Re s >= -{d.within:g}/s")
    if d.gain_limit is not None:
        parts.append(f"|K| <= {d.gain_limit:g}")
    if d.peak_control is not None:
        parts.append(f"|u_i| <= {', '.join(f'{x:g}' for x in d.peak_control)}")
    return ", ".join(parts)
