"""Certify the least gamma, or the stability, of a given gain or of the system without control.

As in `cosim.hinf.synthesis.synthesis`: the solver's least gamma, then a little above it a point
of great margin, then the exact proof; where that fails, a little higher. The conditions
(`conditions`) are tried in turn, the sharpest first, at every order that is affordable, and the
best proof is claimed.

"Not certified" is a result, not an error: the conditions are sufficient only. The figures of
the nominal loop are given beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError, counted
from cosim.hinf.certificate import Damping, Guarantees, check_measured, checked_damping
from cosim.hinf.delay_lti import (
    BEYOND,
    DelayLTI,
    NominalFigures,
    checked_system,
    figures_if_known,
    verdict_of,
)
from cosim.hinf.lmi import Condition, not_found, solver_words
from cosim.hinf.problem import ages_are_known
from cosim.hinf.synthesis.conditions import (
    AFFORDABLE_ORDERS,
    affordable_conditions,
    conditions_of,
    exactly_covered,
    is_large,
    prove,
    widened,
)
from cosim.hinf.synthesis.ladder import FAR, least_proved, levels_of_analysis
from cosim.hinf.synthesis.result import Result
from cosim.hinf.theorems import MAX_BOX, MAX_ORDER
from cosim.models import DelaySystem, Matrix

_MUCH = 0.1  # share of gamma worth a proof of exactly these delays, or an odd gain


Order = int | Literal["auto"]


def analyse(
    system: DelaySystem | DelayLTI,
    gain: ArrayLike | None = None,
    gamma: float | None = None,
    *,
    order: Order = "auto",
    damping: float | None = None,
    within: float | None = None,
) -> Result:
    """Certify the least gamma of u = K x, or stability where there is no w or no z.

        >>> from cosim import DelaySystem, analyse, link
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]], delays=[link(0.5)])
        >>> calm, hasty = analyse(system, [[-1.0]]), analyse(system, [[-5.0]])
        >>> calm.verdict, calm.gamma < 1.5, calm.covers_smaller_delays
        ('certified', True, True)
        >>> hasty.verdict, hasty.gamma
        ('unstable', None)

    Parameters
    ----------
    system : Eq. (7) with any number of delays (n states, m inputs); a `DelayLTI` is taken as the
        system of its roots and norm (`DelayLTI.system`).
    gain : (m, n) K; None for u = 0.
    gamma : a bound to prove instead of the least one.
    order : 0 for Theorem 1, which covers every constant delay up to the system's; N > 0 for the
        Bessel-Legendre condition of order N, which covers exactly these delays, or every one up
        to them if that can be proved at the same gamma (`Result.covers_smaller_delays`). Ages
        are taken as they are from order 1 on, and at any order where more is known of one than
        its bound (`cosim.hinf.synthesis.conditions`). "auto": the best proof of the orders that
        take a few seconds at most.
    damping, within : also prove that every characteristic root s of the nominal loop with
        Re s >= -within [1/s] has a damping ratio above `damping`, between 0 and 1.

    Raises
    ------
    InputError : numbers that do not fit the system. A gain of any size is none of these: where
        numbers leave the range of doubles, the verdict is "undecided", and `reason` says why.
    """
    system = checked_system(system.system() if isinstance(system, DelayLTI) else system)
    K = gain_of(system, gain)
    check_order_of_analysis(order)
    if gamma is not None:
        check_gamma(gamma, system)
    asked = checked_damping(system, damping, within)
    figures, unknown = figures_if_known(system, K)
    try:
        with np.errstate(over="raise", invalid="raise"):
            analysis = best_analysis(system, K, gamma, order, figures)
        if unknown is not None and analysis.certificate is None:
            analysis = replace(analysis, reason=f"{unknown}; {analysis.reason}")
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        reason = unknown or f"{BEYOND} ({error}): choose other units"
        first = AFFORDABLE_ORDERS[0] if order == "auto" else order
        analysis = Result(system, K, None, figures, None, first, reason=reason)
    if asked is not None:
        analysis = _with_damping(analysis, K, asked)
    return analysis


def _with_damping(analysis: Result, K: Matrix, asked: Damping) -> Result:
    """Return an analysis with the damping that is proved of its gain, or why it is not."""
    reason = asked.failure(analysis.system, K)
    if reason is not None:
        return replace(analysis, damping_reason=reason)
    proved, certificate = Guarantees(damping=asked), analysis.certificate
    certificate_with_it = None if certificate is None else proved.beside(certificate)
    return replace(analysis, guarantees=proved, certificate=certificate_with_it)


def check_order_of_analysis(order: Order) -> None:
    """Refuse an order out of range.

    Raises
    ------
    InputError : naming the range.
    """
    if order != "auto" and not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where="order",
            expected=f"0 (Theorem 1) to {MAX_ORDER}",
            got=str(order),
        )


def best_analysis(
    system: DelaySystem,
    K: Matrix,
    gamma: float | None,
    order: Order,
    figures: NominalFigures,
    *,
    ranking: bool = False,
    below: float | None = None,
) -> Result:
    """Return the best proof of this order or of all; where there is none, what came nearest.

    ranking : of all orders only what is quick, to compare gains with each other.
    below : a gamma that is proved already: only what is clearly less is tried.
    """
    made: list[Result] = []
    root = figures.abscissa
    excluded = root is not None and root >= 0 and not any(x.sampled for x in system.delays)
    how: Any = {"performance": system.has_performance, "large": is_large(system, K)}
    known = ages_are_known(system) or how["large"]
    orders = [order] if order != "auto" else [1, 0] if known else [*AFFORDABLE_ORDERS]
    if ranking and known:
        orders = sorted(orders)  # the quick one first
    for each in orders:
        conditions: list[Condition] = []
        if order == "auto" and not excluded:
            conditions = affordable_conditions(system, K, each, ranking=ranking, **how)
        elif not excluded:
            conditions = conditions_of(system, K, each, **how)
        if not conditions and not excluded:
            continue
        last = _analysed(system, K, gamma, each, conditions, figures, below)
        made.append(last)
        if last.gamma is not None:
            below = min(_worth(last), np.inf if below is None else below)
        asked = gamma is not None or last.gamma is None
        if last.certificate is not None and (
            asked or is_exact(last) or (known and not _is_far(last))
        ):
            break
    certified = [one for one in made if one.certificate is not None]
    if certified:
        return preferred(certified)
    return min(made, key=lambda one: np.inf if one.least_gamma is None else one.least_gamma)


def preferred(proved: Sequence[Result]) -> Result:
    """Return the proof of least gamma; where little is lost, one that covers smaller delays.

    So too one whose nominal figures can be computed: otherwise its gain is out of all proportion.
    """
    return min(proved, key=_worth)


def _worth(one: Result) -> float:
    """Return the gamma of a proof that covers smaller delays and is worth as much."""
    worse = (not one.covers_smaller_delays) + 2 * (one.abscissa is None)
    return (one.gamma or 0.0) * (1.0 + _MUCH) ** worse


def is_exact(one: Result) -> bool:
    """Whether no analysis of the same gain can be sharper: gamma is the nominal norm."""
    return bool(one.exact_norm and (one.gamma or 0.0) < one.exact_norm * (1 + 1e-3))


def _is_far(one: Result) -> bool:
    """Return whether a gamma is proved far above the least one: another order may do better."""
    if one.gamma is None or one.least_gamma is None:
        return False
    return one.gamma > one.least_gamma * (1.0 + FAR[0] / 2)


def _analysed(
    system: DelaySystem,
    K: Matrix,
    gamma: float | None,
    order: int,
    conditions: Sequence[Condition],
    figures: NominalFigures,
    below: float | None,
) -> Result:
    """Analyse a gain whose nominal figures are known, by conditions of one order.

    below : as in `best_analysis`.
    """
    delays = [delay.d for delay in system.delays]
    proof, level, reason = None, None, None
    leasts: list[float] = []
    if not conditions:
        reason = verdict_of(system, K, figures.abscissa or 0.0)[1]
    floor = float(np.linalg.norm(system.D1, 2))
    reference = max(floor, figures.exact_norm or 0.0) or 1.0
    for condition in conditions:
        at_level, wide = partial(prove, condition, system, K), False
        if system.has_performance:
            with solver_words() as words:
                least = condition.least_gamma(delays, reference)
            leasts += [] if least is None else [least]
            if gamma is None and least is None:
                reason = reason or f"no gamma was found: {not_found(words)}"
                continue
        if gamma is None and leasts:
            reason = f"nothing clearly below gamma = {below} was found"
            exactly = exactly_covered(condition, system)
            # where a proof of exactly these delays would not be preferred: one for smaller ones too
            wide = bool(exactly) and below is not None and leasts[-1] * (1.0 + _MUCH) > below
            at_level = partial(at_level, down_to_zero=True) if wide else at_level
            corners = 2**exactly if wide else 0
            levels = levels_of_analysis(leasts[-1], condition.unknowns(delays), below, corners)
            norm = figures.exact_norm or leasts[-1]
            if wide and below is not None and norm * (1.0 + _MUCH) < below:
                levels = levels[:1]  # a higher order may prove exactly these delays
            if not levels or (wide and exactly > MAX_BOX):
                continue
            proved, reason = least_proved(levels, at_level)
            level, proof = proved or (None, None)
        else:
            level = gamma
            proof, reason = at_level(gamma)
        if proof is not None:
            proof = proof if wide else widened(condition, system, K, level) or proof
            break
    return Result(
        system=system,
        K=K,
        order=order,
        reason=None if proof is not None else reason,
        gamma=None if proof is None else level,
        least_gamma=(leasts[-1] if proof is not None else min(leasts)) if leasts else None,
        certificate=proof,
        figures=figures,
    )


def gain_of(system: DelaySystem, gain: ArrayLike | None) -> NDArray[np.float64]:
    """Return K as (m, n) doubles, zero for None.

    Raises
    ------
    InputError : it does not fit the system.
    """
    n, m = system.B.shape
    if gain is None:
        return np.zeros((m, n))
    try:
        K = np.array(gain, dtype=np.float64)
    except (TypeError, ValueError):
        K = np.full((1, 1), np.nan)
    if not m and K.size:
        raise InputError(
            "this gain acts on nothing: the system has no control, B is missing",
            where=f"{system.name}: B" if system.name else "B",
            expected=f"B, {n} rows with one column per control",
            got="no B",
            hint="give B beside A, or leave the gain out",
        )
    if K.shape != (m, n) or not np.isfinite(K).all():
        raise InputError(
            "the gain does not fit the system",
            where="gain",
            expected=f"{counted(m, 'row')} of {counted(n, 'finite number')}",
            got=f"shape {np.shape(K)}" if np.isfinite(K).all() else "not only finite numbers",
        )
    check_measured(K, system)
    return K


def check_gamma(gamma: float, system: DelaySystem) -> None:
    """Refuse a gamma that is not positive, and any gamma of a system without w and z.

    Raises
    ------
    InputError : naming which.
    """
    if not (np.isfinite(gamma) and gamma > 0):
        raise InputError("gamma must be a positive number", where="gamma", got=repr(gamma))
    if not system.has_performance:
        raise InputError(
            "this system has no gain to bound",
            where="gamma",
            expected="a system with C and with D, D1 or D2",
            got=f"{gamma:g}",
        )
