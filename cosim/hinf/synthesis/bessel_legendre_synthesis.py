"""Design a gain with the Bessel-Legendre inequality of order N, and prove it by its analysis.

The LMI of `bessel_legendre_lmi` is convex for given multipliers. The analysis of a gain gives
multipliers with which a design loses nothing, and that design gives the next gain: gamma falls
from round to round. It starts at the better of the gain of Theorem 2 (at k1, k2) and those of a
few scalar multipliers. Where no start is feasible, a gain for short delays is continued to
longer ones.

All this is floating point. The claim of a design is what the exact analysis of order N proves
for the rounded gain (`analysis_proof`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from cosim.core import InputError, NotAchievableError
from cosim.hinf.certificate import MAX_ORDER
from cosim.hinf.lmi import (
    AnalysisLmi,
    BesselLegendreLmi,
    multipliers_of,
    not_found,
    scalar_multipliers,
    solver_words,
)
from cosim.hinf.nominal import checked_system
from cosim.hinf.synthesis.analysis import Analysis, analyse
from cosim.hinf.synthesis.bessel_legendre_loop import SCALES, Gain, Loop, continue_gain, rounded
from cosim.hinf.synthesis.ladder import first_proved
from cosim.models import DelaySystem

_ROUNDS = 25
_WELL_ABOVE = 1.1  # starting gains have the greatest margin at this multiple of the least gamma
_ABOVE = 1e-3  # share above the least gamma at which the multipliers of a gain are taken
_ENOUGH = 2e-4  # relative decrease of gamma in a round below which the rounds end
_SHORT = 1 / 64  # start of a continuation, as a share of the delays


def bessel_legendre_gain(
    system: DelaySystem, order: int, starts: Sequence[Gain], gamma: float | None
) -> Analysis:
    """Design gains, and return the analysis of the best one that is proved.

    Parameters
    ----------
    system : Eq. (7) with a positive delay.
    order : N, 0 to `MAX_ORDER`.
    starts : (m, n) gains to start from, beside those found here.
    gamma : a bound to meet instead of the least one; None also for a system without w, z.

    Raises
    ------
    InputError : the order is out of range.
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

    def prove(K: Gain) -> tuple[Analysis | None, str]:
        try:
            found = analyse(system, K, gamma, order=order)
        except NotAchievableError as error:  # a loop too fast for its roots to be counted
            return None, error.what
        return (found, "") if found.certified else (None, str(found.reason))

    proved, reason = first_proved(gains, prove)
    if proved is not None:
        return proved
    goal = "stability" if gamma is None else f"gamma = {gamma:g}"
    raise NotAchievableError(
        f"no gain could be certified at order {order}",
        where=system.name or None,
        expected=f"an exact proof of {goal}",
        got=f"{len(gains)} gains, none of them proved; of the last, {reason}"
        if gains
        else f"no gain was found from {len(starts)} gains of Theorem 2, {len(SCALES)} scalar "
        f"multipliers and shorter delays: {not_found(words)}",
        hint="a larger gamma, a shorter delay, a smaller envelope, another order",
    )


def _scalar_gains(system: DelaySystem, order: int) -> list[Gain]:
    """Return the gains of least gamma with scalar multipliers."""
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
    """Return a gain for the delays of `loop`, by continuation from short delays; [] if it ends."""
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
    """Return gains of decreasing gamma from the best start, best first; stop below `goal`."""

    def least(K: Gain, reference: float) -> float:
        return _least_gamma(system, order, K, reference) or np.inf

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
    """Return the gain of greatest margin at `gamma`, and the one it was computed from."""
    for K in gains[:1]:
        with solver_words() as words:
            least = _least_gamma(system, order, K, gamma)
        if least is None or not least < gamma:
            raise NotAchievableError(
                f"gamma = {gamma:g} was not reached at order {order}",
                where=system.name or None,
                expected=f"a gain whose analysis has less than {gamma:g}",
                got=not_found(words) if least is None else f"{least:.6g}, the least that was found",
                hint="other k1, k2 to start from, or a search for them; a higher order",
            )
        found = Loop(system, order, gamma).improved_gain(K)
        return [K] if found is None else [found[1], K]
    return []


def _least_gamma(system: DelaySystem, order: int, K: Gain, reference: float) -> float | None:
    """Return the least gamma of the analysis of K, near `reference`; None if none is found."""
    lmi = AnalysisLmi(system, K, order, performance=True)
    return lmi.least_gamma([delay.d for delay in system.delays], reference)


def _round(system: DelaySystem, order: int, gamma: float, K: Gain) -> Gain | None:
    """Return a gain of less gamma, by the multipliers of K, away from the edge; None: none."""
    delays = [delay.d for delay in system.delays]
    analysis = AnalysisLmi(system, K, order, performance=True)
    found = analysis.margin(delays, (1 + _ABOVE) * gamma)
    if found is None:
        return None
    multipliers = multipliers_of(found[1], system)
    lmi = BesselLegendreLmi(system, order, K, gamma)
    least = lmi.least_gamma(multipliers)
    if least is None:
        return None
    for share in (0.1, 0.4):
        level = max(least[0] + share * (gamma - least[0]), (1 + _ABOVE / 4) * least[0])
        middle = rounded(lmi.central(multipliers, level))
        if middle is not None and middle[0] > 0:
            return middle[1]
    return None


def check_order(order: int, system: DelaySystem) -> None:
    """Refuse an order out of range, and a system without a positive delay or without B.

    Raises
    ------
    InputError : naming which.
    """
    if not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where="order",
            expected=f"0 to {MAX_ORDER}, or no order for Theorem 2",
            got=str(order),
        )
    if not any(delay.d > 0 for delay in system.delays):
        raise InputError(
            "an order applies to a delay, and this system has no positive one",
            where="order",
            expected="a positive delay",
            hint="leave the order out: without a delay Theorem 2 loses nothing",
        )
    checked_system(system, control=True)
