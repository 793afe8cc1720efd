"""Make a design of a proof of Theorem 2, or of an analysis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import NotAchievableError
from cosim.hinf.certificate import certificate_to_json, gamma_floor
from cosim.hinf.delay_lti import (
    figures_if_known,
    nominal_figures_of,
)
from cosim.hinf.lmi import Scaling, not_found, solver_words
from cosim.hinf.synthesis.analysis import (
    Order,
    analyse,
    best_analysis,
    check_gamma,
    gain_of,
)
from cosim.hinf.synthesis.not_achievable import hint_after
from cosim.hinf.synthesis.result import Result
from cosim.hinf.theorems import Proof, Theorem2
from cosim.models import DelaySystem, Matrix

GAIN_DIGITS = 6
"""Significant digits of a designed gain, relative to its largest entry."""


class GammaFloorError(NotAchievableError):
    """No controller has a gamma as small as this: the gain at high frequency is that of D1."""


def design_of_theorem_2(
    system: DelaySystem, K: Matrix, proof: Proof, least: float | None
) -> Result:
    """Return the design of a gain that Theorem 2 proves, with the figures of its nominal loop."""
    figures, _ = figures_if_known(system, K)
    theorem = cast("Theorem2", proof.theorem)
    return Result(
        system=system,
        K=K,
        gamma=None if proof.gamma is None else float(proof.gamma),
        k1=tuple(map(float, theorem.k1)),
        k2=tuple(map(float, theorem.k2)),
        least_gamma=least,
        certificate=certificate_to_json(system, K, proof),
        figures=figures,
    )


def proved_by_analysis(
    system: DelaySystem,
    gains: Iterable[Matrix],
    gamma: float | None,
    order: Order,
    *,
    enough: Callable[[Sequence[Result]], bool] = lambda made: made[-1].certificate is not None,
    ranking: bool = False,
) -> Result:
    """Return the best proof of the gains that are proposed, each analysed at this order.

    Parameters
    ----------
    gains : (m, n) proposed gains; made one by one, so that what comes late may cost more.
    gamma : a bound to prove instead of the least one.
    order : of the analysis, or "auto".
    enough : whether these analyses, of the gains so far, end the proposals.
    ranking : compare the gains by quick analyses first, and analyse the best one in full.

    Raises
    ------
    NotAchievableError : none of them is proved, or none was proposed: why.
    """
    made: list[Result] = []
    count, reason = 0, ""
    with solver_words() as words:
        for K in gains:
            count += 1
            try:
                figures = nominal_figures_of(system, K)
            except NotAchievableError as error:  # a loop too fast for its roots to be counted
                reason = error.what
                continue
            made.append(best_analysis(system, K, gamma, order, figures, ranking=ranking))
            if enough(made) or (
                made[-1].certificate is not None and (made[-1].gamma is None or gamma is not None)
            ):
                break
            reason = made[-1].reason or reason
    if ranking:
        proved = [one for one in made if one.certificate is not None]
        best = sorted(proved, key=lambda one: one.gamma or 0.0)[:1]
        made += [_in_full(one, gamma, order) for one in best or made]
    proved = [one for one in made if one.certificate is not None]
    if proved:
        return min(proved, key=lambda one: one.gamma or 0.0)
    at_order = "" if order == "auto" else f" at order {order}"
    leasts = [one.least_gamma for one in made if one.least_gamma is not None]
    if gamma is not None and leasts and min(leasts) > gamma:
        raise NotAchievableError(
            f"gamma = {gamma:g} was not reached{at_order}",
            where=system.name or None,
            expected=f"a gain whose analysis has less than {gamma:g}",
            got=f"{min(leasts):.6g}, the least that was found",
            hint="a larger gamma, or a higher order",
        )
    goal = "stability" if gamma is None else f"gamma = {gamma:g}"
    failure = reason if count else not_found(words)
    raise NotAchievableError(
        f"no gain could be certified{at_order}",
        where=system.name or None,
        expected=f"an exact proof of {goal}",
        got=f"{count} gains, none of them proved; of the last, {failure}"
        if count
        else f"no gain was found: {failure}",
        hint=hint_after(failure, "a larger gamma, a shorter delay, another order"),
    )


def quickly_proved(system: DelaySystem, gain: ArrayLike) -> Result | None:
    """Return the best proof of a given gain that takes about a second; None without one.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : roots of the nominal loop that cannot be found.
    """
    K = gain_of(system, gain)
    figures = nominal_figures_of(system, K)
    analysis = best_analysis(system, K, None, "auto", figures, ranking=True)
    return None if analysis.certificate is None else analysis


def _in_full(quick: Result, gamma: float | None, order: Order) -> Result:
    """Return the full analysis of the gain of a quick one."""
    return best_analysis(quick.system, gain_of(quick.system, quick.K), gamma, order, quick.figures)


def given_gain_design(
    system: DelaySystem, gain: ArrayLike, gamma: float | None, order: Order
) -> Result:
    """Return the design of a given gain: its analysis, which must be certified.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : it is not.
    """
    analysis = analyse(system, gain, gamma, order=order)
    if analysis.certificate is None:
        raise NotAchievableError(
            "this gain could not be certified" + ("" if order == "auto" else f" at order {order}"),
            where=system.name or None,
            expected="an exact proof" if gamma is None else f"a proof of gamma = {gamma:g}",
            got=analysis.reason,
            hint=hint_after(str(analysis.reason), "a larger gamma, another order"),
        )
    return analysis


def rounded_gain(K: Matrix, units: Scaling | None = None) -> Matrix:
    """Round K to `GAIN_DIGITS` significant digits of its largest entry; the rest is noise.

    units : in which states and inputs compare: largest in these, each entry to decimals of its
        own; None: the system's.
    """
    if not K.any():
        return K  # no inputs, or nothing that acts
    largest = np.full(K.shape, np.abs(K).max())
    if units is not None:
        largest = np.abs(units.gain(K)).max() * units.input[:, None] / units.state
    decimals = GAIN_DIGITS - 1 - np.floor(np.log10(largest)).astype(int)
    rounded = [
        [round(k, int(d)) for k, d in zip(*x, strict=True)] for x in zip(K, decimals, strict=True)
    ]
    return np.array(rounded, dtype=np.float64) + 0.0  # no negative zero


def check_achievable(gamma: float, system: DelaySystem) -> None:
    """Refuse a gamma that no delay, k1, k2 or gain can achieve.

    Raises
    ------
    InputError : no positive number, or a system without w and z.
    GammaFloorError : gamma <= ||D1||.
    """
    floor = float(np.linalg.norm(system.D1, 2)) if system.D1.size else 0.0
    check_gamma(gamma, system)
    proof = gamma_floor(system, gamma)
    if proof is not None or gamma <= floor:
        raise GammaFloorError(
            f"no gamma <= ||D1|| = {floor:g} exists: at high frequency the gain from w to z is "
            "that of D1, for any controller",
            where=system.name or None,
            expected=f"gamma > {floor:g}",
            got=f"{gamma:g}"
            + (
                ", which is ||D1|| to the last digits"
                if proof is None
                else f"; proved in rational arithmetic: |D1 w| >= {gamma:g} |w|"
            ),
            hint="a larger gamma, or another D1; no delay and no gain helps",
            certificate=proof,
        )
