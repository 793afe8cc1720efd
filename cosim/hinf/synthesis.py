"""Least gamma for given delays (Remark 2), with a gain that is certified as it flies.

Steps, for a gain to be found or one that is given:

1. minimise gamma over the LMI (`cosim.hinf.problem`), k1 and k2 given;
2. a little above the least gamma, maximise the margin of the LMI against its own scale: a
   solution in the middle of what is feasible, where rounding does no harm;
3. round the gain to a few decimals; what differs from machine to machine in a solver's last
   digits does not reach what flies;
4. with the rounded gain fixed, maximise the margin again, and prove the result exactly
   (`cosim.hinf.certificate`). Where the proof fails, step 2 starts again a little higher.

The gamma of a design is the gamma of its proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.errors import InputError, NotAchievableError
from cosim.hinf.analysis_proof import covers_smaller
from cosim.hinf.assembly import Scalars
from cosim.hinf.certificate import Variables, certificate_to_json, certify
from cosim.hinf.problem import Answer, Point, Problem
from cosim.hinf.search import least_gamma, widest_margin
from cosim.hinf.threads import one_thread
from cosim.hinf.yardsticks import measured
from cosim.models.delay_system import DelaySystem

GAIN_DIGITS = 6
"""Significant digits of a designed gain, relative to its largest entry."""

_ABOVE_LEAST = (2e-6, 1e-5, 5e-5, 1e-4, 3e-4, 2e-3, 1e-2, 5e-2)


@dataclass(frozen=True, eq=False)
class Design:
    """A gain and what is known of it.

    Attributes
    ----------
    system : what it is designed for.
    K : (m, n) the gain, as the doubles that fly.
    gamma : certified bound of the gain from w to z, uncertainty included; None where the
        system has no w or no z, and stability alone is certified.
    k1, k2 : one per delay; empty where the proof has an `order`.
    least_gamma : the solver's least gamma at k1, k2: not a proof, a lower end to compare with.
    abscissa, exact_norm, exact_norm_upper, norm_frequency, delay_margin : of the nominal loop
        (`cosim.hinf.yardsticks`); an upper bound or margin of None may also be one that an
        older file does not hold.
    certificate : the proof as JSON values, for `check_certificate`.
    order : of the Bessel-Legendre inequality in the proof, which is then the analysis of K and
        has no k1, k2; None for Theorem 2.
    """

    system: DelaySystem
    K: NDArray[np.float64]
    gamma: float | None
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    least_gamma: float | None
    abscissa: float
    exact_norm: float | None
    exact_norm_upper: float | None
    norm_frequency: float | None
    delay_margin: tuple[float | None, ...] | None
    certificate: dict[str, Any]
    order: int | None = None

    @property
    def up_to(self) -> bool:
        """Whether the proof covers every delay up to the system's, not exactly these alone."""
        return self.order is None or covers_smaller(self.certificate["claim"])

    @property
    def certified(self) -> bool:
        """Always true: a `Design` exists only behind a proof."""
        return True


@one_thread
def design(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool = False,
) -> Design:
    """The gain of least gamma, or of a given gamma, or the least gamma of a given gain.

    Parameters
    ----------
    system : Eq. (7) with delays (n states, m inputs).
    k1, k2 : one number per delay, k2 not zero (Theorem 2).
    gamma : a bound to be met instead of the least one; the design's own may be lower.
    gain : (m, n) a gain to be analysed instead of designed.
    search : look for better k1, k2 (`cosim.hinf.search`), starting from these among others.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : the LMI has no certified solution at k1, k2 (and gamma).
    """
    scalars = checked_scalars(system, k1, k2)
    fixed = None if gain is None else _fitting(gain, system)
    if gamma is not None:
        check_reachable(gamma, system)
    problem = Problem(system)
    if search:
        scalars = _searched(problem, scalars, fixed)
    one, two = scalars.k1, scalars.k2
    least = _least(problem, scalars, fixed, system.name) if system.has_performance else None
    if gamma is not None:
        levels: list[float | None] = [gamma]
        if least is not None and gamma < least * (1 - 1e-7):
            raise NotAchievableError(
                f"gamma = {gamma:g} cannot be reached with these k1, k2",
                where=system.name or None,
                expected=f"gamma >= {least:.6g}, the least of the LMI at k1 = {list(one)}, "
                f"k2 = {list(two)}",
                got=f"{gamma:g}",
                hint="another k1, k2: the least gamma depends on them strongly",
            )
        if least is not None:
            # what is proved for less is proved for gamma, and far above the least level the
            # numbers of the LMI lie far apart
            levels += [level for level in _levels(least) if level < gamma]
    else:
        levels = [None] if least is None else [*_levels(least)]
    reason = ""
    for level in levels:
        found, reason = proved_at(system, problem, scalars, level, fixed)
        if found is not None:
            return finished(system, *found, least)
    bounds = [level for level in levels if level is not None]
    goal = f"gamma <= {max(bounds):.6g}" if bounds else "stability"
    raise NotAchievableError(
        "no solution of the LMI could be certified",
        where=system.name or None,
        expected=f"an exact proof of {goal} at k1 = {list(one)}, k2 = {list(two)}",
        got=reason,
        hint="another k1, k2 (start from k1 = -k2), a shorter delay, a smaller envelope",
    )


def _levels(least: float) -> list[float]:
    return [_rounded_up(least * (1 + share)) for share in _ABOVE_LEAST]


def proved_at(
    system: DelaySystem,
    problem: Problem,
    p: Scalars,
    gamma: float | None,
    gain: NDArray[np.float64] | None = None,
) -> tuple[tuple[NDArray[np.float64], Variables] | None, str]:
    """A gain with variables that prove it at `gamma`, or None and why."""
    found = _central(problem, p, gamma, gain)
    if found is None:
        return None, "the solver finds no feasible point"
    proof = certify(system, *found)
    return (found, "") if proof.valid else (None, str(proof.reason))


def finished(
    system: DelaySystem, K: NDArray[np.float64], variables: Variables, least: float | None
) -> Design:
    """A proved gain with what is computed of its loop."""
    return Design(
        system=system,
        K=K,
        gamma=variables.gamma,
        k1=variables.k1,
        k2=variables.k2,
        least_gamma=least,
        certificate=certificate_to_json(system, K, variables),
        **measured(system, K)._asdict(),
    )


def _searched(problem: Problem, p: Scalars, gain: NDArray[np.float64] | None) -> Scalars:
    """Better k1, k2; those of `p` where none are found."""
    if problem.structure.gamma is None:
        found = widest_margin(problem, p, None, gain)
    else:
        found = least_gamma(problem, p, gain)
    return p if found is None else found[0]


def _least(problem: Problem, p: Scalars, gain: NDArray[np.float64] | None, name: str) -> float:
    """Remark 2: the least gamma, as far as the solver's word goes."""
    answer = problem.least_gamma(p, gain)
    if isinstance(answer, Answer):
        return answer.value
    raise NotAchievableError(
        "the LMI has no solution for any gamma",
        where=name or None,
        expected=f"a feasible LMI at k1 = {list(p.k1)}, k2 = {list(p.k2)}",
        got=f"the solver says {answer.status}",
        hint="another k1, k2 (start from k1 = -k2), a shorter delay, a smaller envelope",
    )


def _central(
    problem: Problem, p: Scalars, gamma: float | None, gain: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], Variables] | None:
    """A gain and variables with a margin at `gamma`; None if the solver finds none."""
    if gain is None:
        first = _with_margin(problem, p, gamma, None)
        if first is None:
            return None
        gain = _rounded(np.asarray(np.linalg.solve(first.X, first.Y.T).T, dtype=np.float64))
    point = _with_margin(problem, p, gamma, gain)
    if point is None:
        return None
    return gain, Variables(point.X, point.Q, point.R, point.eps, p.k1, p.k2, gamma)


def _with_margin(
    problem: Problem, p: Scalars, gamma: float | None, gain: NDArray[np.float64] | None
) -> Point | None:
    """The widest margin; two rounds, the second on the first one's scale."""
    first = problem.margin(p, gamma, gain)
    if first is None or first.value <= 0:
        return None
    second = problem.margin(p, gamma, gain, problem.size_of(p, first.point))
    return first.point if second is None or second.value <= 0 else second.point


def _rounded(K: NDArray[np.float64]) -> NDArray[np.float64]:
    """K to `GAIN_DIGITS` significant digits of its largest entry; what is left is noise."""
    if not K.any():
        return K  # no inputs, or nothing that acts
    decimals = GAIN_DIGITS - 1 - int(np.floor(np.log10(np.abs(K).max())))
    rounded: NDArray[np.float64] = np.round(K, decimals) + 0.0  # no negative zero
    return rounded


def _rounded_up(gamma: float) -> float:
    """Seven significant digits, upward."""
    digits = 6 - int(np.floor(np.log10(gamma)))
    return float(np.ceil(gamma * 10**digits) / 10**digits)


def checked_scalars(system: DelaySystem, k1: Sequence[float], k2: Sequence[float]) -> Scalars:
    """k1, k2 and the system's delays; an `InputError` where they do not fit it."""
    one, two = _scalars("k1", k1, system), _scalars("k2", k2, system)
    if any(value == 0 for value in two):
        raise InputError("k2 must not be zero", where="k2", got=str(list(two)))
    return Scalars(one, two, tuple(delay.d for delay in system.delays))


def _scalars(name: str, values: Sequence[float], system: DelaySystem) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != len(system.delays) or not all(np.isfinite(numbers)):
        raise InputError(
            f"{name} does not fit the system",
            where=name,
            expected=f"{len(system.delays)} finite numbers, one per delay",
            got=str(list(numbers)),
        )
    return numbers


def _fitting(gain: ArrayLike, system: DelaySystem) -> NDArray[np.float64]:
    K = np.asarray(gain, dtype=np.float64)
    n, m = system.B.shape
    if K.shape != (m, n) or not np.isfinite(K).all():
        raise InputError(
            "the gain does not fit the system",
            where="gain",
            expected=f"{m} rows of {n} finite numbers",
            got=f"shape {K.shape}",
        )
    return K


def check_reachable(gamma: float, system: DelaySystem) -> None:
    """Refuse a gamma that no delay, k1, k2 or gain can reach.

    Raises
    ------
    InputError : no positive number, or a system without w and z.
    NotAchievableError : gamma <= ||D1||.
    """
    floor = float(np.linalg.norm(system.D1, 2)) if system.D1.size else 0.0
    if not (np.isfinite(gamma) and gamma > 0):
        raise InputError("gamma must be a positive number", where="gamma", got=repr(gamma))
    if not system.has_performance:
        raise InputError(
            "this system has no gain to bound",
            where="gamma",
            expected="a system with C and with D, D1 or D2",
        )
    if gamma <= floor:
        raise NotAchievableError(
            f"no gamma <= ||D1|| = {floor:g} exists: at high frequency the gain from w to z is "
            "that of D1, whatever the controller does",
            where=system.name or None,
            expected=f"gamma > {floor:g}",
            got=f"{gamma:g}",
        )
