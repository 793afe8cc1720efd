"""Least gamma for given delays by Theorem 2 (Remark 2), certified for the rounded gain.

Steps, for a gain to be designed or a given one:

1. minimise gamma over the LMI (`cosim.hinf.lmi.problem`), k1 and k2 given;
2. a little above the least gamma, maximise the margin of the LMI relative to its own scale: a
   point inside the feasible set, where rounding does no harm;
3. round the gain to a few decimals, which removes the differences of a solver's last digits
   between machines, and prove the result exactly (`cosim.hinf.certificate.certificate`);
4. where that fails, with the rounded gain fixed, maximise the margin again and prove that. If
   this fails too, go back to step 2 a little higher (`cosim.hinf.synthesis.ladder`), or to other
   k1, k2 that the search passed.

The gamma of a design is the gamma of its proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, NotAchievableError, counted
from cosim.hinf.certificate import theorem_2_proof
from cosim.hinf.delay_lti import one_thread
from cosim.hinf.lmi import (
    Answer,
    Problem,
    Scaling,
    check_size,
    not_found,
    solver_words,
    without_performance,
)
from cosim.hinf.problem import refuse_structure
from cosim.hinf.synthesis.analysis import gain_of
from cosim.hinf.synthesis.designs import check_achievable, design_of_theorem_2, rounded_gain
from cosim.hinf.synthesis.gain_size import gain_remark
from cosim.hinf.synthesis.ladder import (
    FAR,
    NEAR,
    clearly_below,
    first_proved,
    least_proved,
    levels_above,
)
from cosim.hinf.synthesis.not_achievable import (
    gamma_below_least,
    is_zero_gamma,
    no_feasible_gamma,
    no_least_gamma,
    not_certified,
)
from cosim.hinf.synthesis.result import Result
from cosim.hinf.synthesis.search import least_gamma, widest_margin
from cosim.hinf.theorems import Proof, Scalars
from cosim.models import DelaySystem

_NEAR = 1.2  # up to this multiple of the least gamma, the scale of its solution is used
_POINTS = 4  # pairs k1, k2 of a search at which a proof is tried
_LARGE = 200  # unknowns from which a solve takes a second
_ROOM = 2  # levels left out there: nearer ones take two solves to prove
_COARSE = 4  # levels near the least gamma that are left out at all pairs but the best


class OutOfProportionError(NotAchievableError):
    """The least gamma is approached as the gain grows without bound: a price on it helps.

    least : this gamma, at the best k1, k2 that were tried.
    """

    def __init__(self, what: str, *, least: float, **parts: Any) -> None:
        super().__init__(what, **parts)
        self.least = least


@one_thread
def design(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool = False,
    problem: Problem | None = None,
    in_proportion: bool = False,
    below: float | None = None,
) -> Result:
    """Design and prove a gain by Theorem 2, as `gain_design.design` with k1, k2 given.

    problem : the LMI with further constraints; None for that of Theorem 2 alone.
    in_proportion : refuse a least gamma with a gain out of all proportion (`gain_remark`).
    below : a gamma that is proved already: only what is clearly less is tried.

    Raises
    ------
    InputError : numbers that do not fit the system.
    OutOfProportionError : `in_proportion`, and the gain of the least gamma is not.
    NotAchievableError : the LMI has no certified solution at k1, k2 (and gamma).
    """
    scalars = checked_scalars(system, k1, k2)
    fixed = None if gain is None else gain_of(system, gain)
    if gamma is not None:
        check_achievable(gamma, system)
    problem = problem or Problem(system)

    def is_too_large(answer: Answer) -> bool:
        remark = gain_remark(system, gain_at(answer.unknowns, problem.scaling))
        return remark is not None and not is_zero_gamma(problem, answer)

    ends_at = is_too_large if in_proportion else lambda _: False
    passed = _searched(problem, scalars, fixed, ends_at) if search else [(scalars, None)]
    points = [at for at, _ in passed]

    def refuse_too_large(least: Answer | None) -> None:
        if in_proportion and least is not None and is_too_large(least):
            raise OutOfProportionError(
                "the least gamma is approached as the gain grows without bound",
                where=system.name or None,
                hint="give u a larger weight in z (D2), or bound |K| by `gain_limit`",
                least=least.value,
            )

    refuse_too_large(passed[0][1])
    first = Theorem2Condition(system, problem, points[0], fixed)
    refuse_too_large(first.least)

    def stages() -> Iterator[tuple[list[Theorem2Condition], Sequence[float]]]:
        yield [first], NEAR if problem.size < _LARGE else NEAR[_ROOM:]
        # other k1, k2 are solved only where nothing is proved at the first
        others = [Theorem2Condition(system, problem, p, fixed) for p in points[1:_POINTS]]
        yield others, NEAR[_COARSE:]
        yield [first, *others], FAR

    for conditions, shares in stages():
        for condition in conditions:
            proved = condition.first(gamma, shares, below)
            if proved is not None:
                return design_of_theorem_2(system, *proved, condition.least_gamma)
    if below is not None:
        raise NotAchievableError(f"nothing clearly below gamma = {below:g} was proved")
    raise first.refusal(gamma)


def stabilising_gain(
    system: DelaySystem, k1: Sequence[float], k2: Sequence[float]
) -> NDArray[np.float64] | None:
    """Return the gain of the widest margin of stability found, w and z left out; None: none.

    The LMI of stability is homogeneous, and so better scaled than one with gamma.
    """
    problem = Problem(without_performance(system))
    widest = widest_margin(problem, checked_scalars(system, k1, k2), None)
    if widest is None or not widest[1] > 0:
        return None
    answer = problem.margin(widest[0], None)
    return gain_at(answer.unknowns, problem.scaling) if isinstance(answer, Answer) else None


class Theorem2Condition:
    """Theorem 2 at given k1, k2, as a condition: for a gain to be designed or a given one.

    Parameters
    ----------
    system, problem : the system, and its LMI.
    p : k1, k2 and the delays.
    gain : (m, n) the given gain; None to design one.
    """

    def __init__(
        self, system: DelaySystem, problem: Problem, p: Scalars, gain: NDArray[np.float64] | None
    ) -> None:
        self._system, self._problem, self._p, self._gain = system, problem, p, gain
        self._tried: list[float | None] = []
        self._reason = ""
        with solver_words() as self._words:
            self._least = problem.least_gamma(p, gain) if problem.has_gamma else None

    @property
    def least(self) -> Answer | None:
        """The solver's point of least gamma; None without w and z, or where it finds none."""
        return self._least if isinstance(self._least, Answer) else None

    @property
    def least_gamma(self) -> float | None:
        """The solver's least gamma; None where there is no `least`."""
        return None if self.least is None else self.least.value

    def levels(self, gamma: float | None, shares: Sequence[float]) -> list[float | None]:
        """Return the gammas to try in turn until one is proved; None stands for stability."""
        if self._least is None:
            return [] if self._tried else [None]
        if not isinstance(self._least, Answer):
            tried = gamma is None or self._least.status != "failed" or gamma in self._tried
            return [] if tried else [gamma]
        above: list[float | None] = []
        if not is_zero_gamma(self._problem, self._least):
            above += levels_above(self._least.value, shares)
        if gamma is None:
            return above
        if self._is_below(gamma) and self._least.accurate:
            return []
        # a proof for less holds for gamma too; far above the least, the LMI is badly scaled
        exact = [] if gamma in self._tried else [gamma]
        return [*exact, *(level for level in above if level is not None and level < gamma)]

    def first(
        self, gamma: float | None, shares: Sequence[float], below: float | None
    ) -> tuple[NDArray[np.float64], Proof] | None:
        """Return the gain and the proof of the first of `levels` that is proved; or None."""
        levels = self.levels(gamma, shares)
        above = [level for level in levels if level is not None]
        if gamma is None and above:
            worth = clearly_below(above, below)
            proved = least_proved(worth, self.prove)[0] if worth else None
            return None if proved is None else proved[1]
        return first_proved(levels, self.prove)[0]

    def prove(self, gamma: float | None) -> tuple[tuple[NDArray[np.float64], Proof] | None, str]:
        """Return a gain with its proof at `gamma`, or None and why."""
        near = self._least if isinstance(self._least, Answer) else None
        gains = [self._gain]
        if self._gain is None and near is not None and self._problem.size >= _LARGE:
            # the gain of the least gamma saves a solve, where it has a margin
            gains = [gain_at(near.unknowns, self._problem.scaling), None]
        proved = None
        for gain in gains if self._tried else gains[:1]:
            proved, self._reason = find_certified_gain(
                self._system, self._problem, self._p, gamma, gain, near
            )
            if proved is not None:
                break
        self._tried.append(gamma)
        return proved, self._reason

    def refusal(self, gamma: float | None) -> NotAchievableError:
        """Return the error that says why nothing is proved here, after `prove`."""
        system, problem, p, given = self._system, self._problem, self._p, self._gain is not None
        least = self._least
        if least is not None and not isinstance(least, Answer) and not self._tried:
            return no_feasible_gamma(system, p, least, given=given)
        if isinstance(least, Answer):
            if gamma is not None:
                below = gamma_below_least(system, problem, p, gamma, least, given=given)
                if below is not None:
                    return below
            elif is_zero_gamma(problem, least):
                return no_least_gamma(system, self._words)
        return not_certified(system, p, self._tried, self._reason, given=given)

    def _is_below(self, gamma: float) -> bool:
        least = self.least_gamma
        return least is not None and gamma < least * (1 - 1e-7)


def find_certified_gain(
    system: DelaySystem,
    problem: Problem,
    p: Scalars,
    gamma: float | None,
    gain: NDArray[np.float64] | None = None,
    near: Answer | None = None,
) -> tuple[tuple[NDArray[np.float64], Proof] | None, str]:
    """Return a gain with its proof at `gamma`, or None and why.

    A point of great margin is tried as it is, with the rounded gain; then once more with that
    gain fixed, the margin relative to the scale of the first point.

    near : a solution nearby, whose scale the margin of the first point is relative to.
    """
    if near is not None and gamma is not None and gamma > _NEAR * near.value:
        near = None
    reason = ""
    for _ in range(2 if gain is None or near is None else 1):
        with solver_words() as words:
            answer = problem.margin(p, gamma, gain, near)
        if not isinstance(answer, Answer) or answer.value <= 0:
            return None, reason or not_found(words)
        near = answer
        if gain is None:
            gain = gain_at(answer.unknowns, problem.scaling)
        proof = theorem_2_proof(system, gain, p.k1, p.k2, answer.unknowns)
        failed = proof.failure(system, gain)
        if failed is None:
            return (gain, proof), ""
        reason = failed
    return None, reason


def _searched(
    problem: Problem,
    p: Scalars,
    gain: NDArray[np.float64] | None,
    ends_at: Callable[[Answer], bool],
) -> list[tuple[Scalars, Answer | None]]:
    """Return better k1, k2 and their points of least gamma, the best first; `p` without any."""
    if problem.has_gamma:
        return [*least_gamma(problem, p, gain, ends_at=ends_at)] or [(p, None)]
    widest = widest_margin(problem, p, None, gain)
    return [(p if widest is None else widest[0], None)]


def gain_at(unknowns: dict[str, Any], units: Scaling) -> NDArray[np.float64]:
    """Return the rounded K = Y X^-1 of a solution."""
    K = np.asarray(np.linalg.solve(unknowns["X"], unknowns["Y"].T).T, dtype=np.float64)
    return rounded_gain(K, units)


def checked_scalars(system: DelaySystem, k1: Sequence[float], k2: Sequence[float]) -> Scalars:
    """Return k1, k2 and the system's delays; an `InputError` where they do not fit it."""
    refuse_structure(system, "Theorem 2", "leave out k1, k2, constraints, cvxpy; `order` auto")
    one, two = _scalars("k1", k1, system), _scalars("k2", k2, system)
    check_size("k1", one)
    check_size("k2", two)
    if any(value == 0 for value in two):
        raise InputError("k2 must not be zero", where="k2", got=str(list(two)))
    return Scalars(one, two, tuple(delay.d for delay in system.delays))


def _scalars(name: str, values: Sequence[float], system: DelaySystem) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != len(system.delays) or not all(np.isfinite(numbers)):
        raise InputError(
            f"{name} does not fit the system",
            where=name,
            expected=f"{counted(len(system.delays), 'finite number')}, one per delay",
            got=str(list(numbers)),
        )
    return numbers
