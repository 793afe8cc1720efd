"""A gain designed with the Bessel-Legendre inequality of order N, and proved by its analysis.

The LMI of `sharper_lmi` is convex once its multipliers are given. They are found in turn: the
analysis of a gain gives multipliers with which a design loses nothing, that design gives the
next gain. gamma falls from round to round; it starts at the best of the gain of Theorem 2 (at
k1, k2) and of a few scalar multipliers, so that it ends below both.

Where no start is feasible, a gain for short delays is carried on: a little longer delays, the
multipliers of its analysis, a new gain, until the delays are the system's.

All this is floating point. What a design claims is what the exact analysis of order N proves
of the rounded gain (`analysis_proof`): a certificate of that kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from cosim.core import InputError, NotAchievableError
from cosim.hinf.analysis import Analysis, analyse
from cosim.hinf.analysis_lmi import AnalysisLmi
from cosim.hinf.analysis_proof import MAX_ORDER
from cosim.hinf.bessel_legendre_lmi import BesselLegendreLmi, multipliers_of, scalar_multipliers
from cosim.hinf.bessel_legendre_loop import SCALES, Gain, Loop, continue_gain, rounded
from cosim.hinf.from_control import checked_system
from cosim.hinf.solver_status import not_found, solver_words
from cosim.models import DelaySystem

_ROUNDS = 25
_WELL_ABOVE = 1.1
"""A gain to start from is that of the widest margin at this multiple of the least gamma."""
_ENOUGH = 1e-3
"""A round that lowers gamma by less than this share is the last."""
_SHORT = 1 / 64
"""Where a gain that is carried on starts, as a share of the delays."""


def bessel_legendre_gain(
    system: DelaySystem, order: int, starts: Sequence[Gain], gamma: float | None
) -> Analysis:
    """The analysis of the best gain that is found and proved.

    Parameters
    ----------
    system : Eq. (7) with a positive delay.
    order : N, 0 to `MAX_ORDER`.
    starts : (m, n) gains to start from, beside those that are found here.
    gamma : a bound to be met instead of the least one; None also for a system without w, z.

    Raises
    ------
    InputError : the order is none.
    NotAchievableError : no gain could be certified, or none below `gamma` was found.
    """
    check_order(order, system)
    stable = Loop(system, order, None)
    with solver_words() as words:
        gains = [K for K in starts if stable.is_feasible(K)]
        gains += _scalar_gains(system, order) if system.has_performance else stable.initial_gains()
        if not gains:
            gains = _continued(stable)
    if system.has_performance:
        gains = _descended(system, order, gains, gamma)
        if gamma is not None:
            gains = _met(system, order, gains, gamma)
    else:
        better = [found[1] for K in gains[:1] if (found := stable.improved_gain(K)) is not None]
        gains = [*better, *gains]
    for K in gains:
        # no yardstick measures a loop that is faster by orders of magnitude than its delay
        with suppress(NotAchievableError):
            proved = analyse(system, K, gamma, order=order)
            if proved.certified:
                return proved
    goal = "stability" if gamma is None else f"gamma = {gamma:g}"
    raise NotAchievableError(
        f"no gain could be certified at order {order}",
        where=system.name or None,
        expected=f"an exact proof of {goal}",
        got=f"{len(gains)} gains, none of them proved"
        if gains
        else f"no gain was found from {len(starts)} gains of Theorem 2, {len(SCALES)} scalar "
        f"multipliers and shorter delays: {not_found(words)}",
        hint="a larger gamma, a shorter delay, a smaller envelope, another order",
    )


def _scalar_gains(system: DelaySystem, order: int) -> list[Gain]:
    """The gains of least gamma with scalar multipliers."""
    gains = []
    longest = max(delay.d for delay in system.delays)
    K: Gain = np.zeros(system.B.T.shape)
    size = float(np.linalg.norm(system.D1, 2)) or 1.0
    for scale in SCALES:
        multipliers = scalar_multipliers(scale * longest, system, order)
        first = BesselLegendreLmi(system, order, K, size).least_gamma(multipliers)
        if first is not None:
            lmi = BesselLegendreLmi(system, order, K, first[0])
            middle = rounded(lmi.central(multipliers, _WELL_ABOVE * first[0]))
            if middle is not None and middle[0] > 0:
                gains.append(middle[1])
    return gains


def _continued(loop: Loop) -> list[Gain]:
    """A gain for the delays of `loop`, from one for shorter delays; none if it gets stuck."""
    lengths = np.array([delay.d for delay in loop.system.delays])
    short = loop.at((_SHORT * lengths).tolist())
    for K in short.initial_gains():
        share, found = continue_gain(lambda s: loop.at((s * lengths).tolist()), K, _SHORT, 1.0)[-1]
        if share == 1.0:
            return [found]
    return []


def _descended(
    system: DelaySystem, order: int, starts: Sequence[Gain], goal: float | None
) -> list[Gain]:
    """Gains of less and less gamma from the best start on, best first; `goal` is enough."""
    delays = [delay.d for delay in system.delays]

    def least(K: Gain, reference: float) -> float:
        lmi = AnalysisLmi(system, K, order, performance=True)
        found = lmi.least_gamma(delays, reference)
        return np.inf if found is None else found

    size = float(np.linalg.norm(system.D1, 2)) or 1.0
    ranked = sorted(((least(K, size), K) for K in starts), key=lambda pair: pair[0])
    ranked = [pair for pair in ranked if np.isfinite(pair[0])]
    for _ in range(_ROUNDS):
        if not ranked or (goal is not None and ranked[0][0] < goal):
            break
        gamma, K = ranked[0]
        with suppress(np.linalg.LinAlgError):
            better = _round(system, order, gamma, K)
            if better is not None:
                value = least(better, gamma)
                if value < gamma:
                    ranked.insert(0, (value, better))
        if ranked[0][0] > (1 - _ENOUGH) * gamma:
            break
    return [K for _, K in ranked]


def _met(system: DelaySystem, order: int, gains: list[Gain], gamma: float) -> list[Gain]:
    """The gain of widest margin at `gamma`, and the one that it is made from."""
    for K in gains[:1]:
        delays = [delay.d for delay in system.delays]
        with solver_words() as words:
            least = AnalysisLmi(system, K, order, performance=True).least_gamma(delays, gamma)
        if least is None or not least < gamma:
            raise NotAchievableError(
                f"gamma = {gamma:g} was not reached at order {order}",
                where=system.name or None,
                expected=f"a gain whose analysis has less than {gamma:g}",
                got=not_found(words) if least is None else f"{least:.6g}, the least that was found",
                hint="other k1, k2 to start from, or their search; a higher order",
            )
        found = Loop(system, order, gamma).improved_gain(K)
        return [K] if found is None else [found[1], K]
    return []


def _round(system: DelaySystem, order: int, gamma: float, K: Gain) -> Gain | None:
    """The multipliers of K, and a gain of less gamma with them, in the middle of what is left."""
    delays = [delay.d for delay in system.delays]
    analysis = AnalysisLmi(system, K, order, performance=True)
    found = analysis.margin(delays, (1 + _ENOUGH) * gamma)
    if found is None:
        return None
    multipliers = multipliers_of(found[1], system)
    lmi = BesselLegendreLmi(system, order, K, gamma)
    least = lmi.least_gamma(multipliers)
    if least is None:
        return None
    for share in (0.1, 0.4):
        level = max(least[0] + share * (gamma - least[0]), (1 + _ENOUGH / 4) * least[0])
        middle = rounded(lmi.central(multipliers, level))
        if middle is not None and middle[0] > 0:
            return middle[1]
    return None


def check_order(order: int, system: DelaySystem) -> None:
    """Refuse an order that there is none of, and a system that it means nothing for.

    Raises
    ------
    InputError : naming which.
    """
    if not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where="order",
            expected=f"0 to {MAX_ORDER}; none for Theorem 2",
            got=str(order),
        )
    if not any(delay.d > 0 for delay in system.delays):
        raise InputError(
            "an order belongs to a delay, and this system has none",
            where="order",
            expected="a positive delay",
            hint="leave the order out: without a delay Theorem 2 loses nothing",
        )
    checked_system(system, control=True)
