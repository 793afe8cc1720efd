"""Propose gains with the Bessel-Legendre inequality of order N.

The LMI of `bessel_legendre_lmi` is convex for given multipliers. The analysis of a gain gives
multipliers with which a design loses nothing, and that design gives the next gain: gamma falls
from round to round. It starts at the best of the gains it is given, which those of Theorem 2 may
be, and those of a few scalar multipliers. Where no start is feasible, a gain for short delays is
continued to longer ones.

All this is floating point. The claim of a design is what the exact analysis proves for the
rounded gain (`designs.proved_by_analysis`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.hinf.delay_lti import checked_system
from cosim.hinf.lmi import Condition, GainLmi, multiplier_of, scalar_multiplier
from cosim.hinf.problem import with_delays
from cosim.hinf.synthesis.designs import rounded_gain
from cosim.hinf.theorems import MAX_ORDER, Proof
from cosim.models import DelaySystem

Gain = NDArray[np.float64]

SCALES = (0.02, 0.1, 0.5, 2.0)
"""Scalar multipliers to start from, in units of the longest delay."""

_ROUNDS = 25
_WELL_ABOVE = 1.1  # starting gains have the greatest margin at this multiple of the least gamma
_ABOVE = 1e-3  # share above the least gamma at which the multipliers of a gain are taken
_ENOUGH = 2e-4  # relative decrease of gamma in a round below which the rounds end
_FEW, _PAYS = 4, 3e-3  # rounds from a gain that is proved, and what each has to gain
_SHARES = (0.1, 0.4, 0.8)  # of the way from the least gamma of given multipliers to that of K
_SHORT = 1 / 64  # start of a continuation, as a share of the delays
_SMALLEST_STEP = 1e-3
_TRIES = 40  # near its end a continuation creeps


def bessel_legendre_gains(
    system: DelaySystem,
    order: int,
    starts: Sequence[Gain],
    gamma: float | None,
    *,
    continued: bool = True,
) -> Iterator[Gain]:
    """Yield gains that the analysis of order N should prove, the best first.

    Parameters
    ----------
    system : Eq. (7) with a positive delay.
    order : N, 0 to `MAX_ORDER`.
    starts : (m, n) gains to start from, beside those found here.
    gamma : a bound to meet instead of the least one; None also for a system without w, z.
    continued : follow a gain from short delays to these where no start is feasible.

    Raises
    ------
    InputError : the order is out of range.
    """
    check_order(order, system)
    stable = Loop(system, order, None)
    gains = [K for K in starts if stable.is_feasible(K)]
    gains += _scalar_gains(system, order) if system.has_performance else stable.initial_gains()
    if not gains and continued:
        gains = _continued(stable)
    if not system.has_performance:
        better = [
            improved[1] for K in gains[:1] if (improved := stable.improved_gain(K)) is not None
        ]
        yield from (*better, *gains)
        return
    gains = _descended(system, order, gains, gamma)
    if gamma is not None and gains:
        # of greatest margin at `gamma`
        improved = Loop(system, order, gamma).improved_gain(gains[0])
        gains = [gains[0]] if improved is None else [improved[1], gains[0]]
    yield from gains


def improved_gain(system: DelaySystem, K: Gain) -> Gain | None:
    """Return a gain of less gamma at order 0 than K, by a few rounds from it; None: none.

    system : as of `bessel_legendre_gains`, with w and z.
    """
    best = _descended(system, 0, [K], None, rounds=_FEW, enough=_PAYS)
    return None if not best or best[0] is K else best[0]


class Loop:
    """Design and analysis of gains for one system at one order, in floating point."""

    def __init__(self, system: DelaySystem, order: int, gamma: float | None) -> None:
        self.system, self.order, self.gamma = system, order, gamma
        self._delays = [delay.d for delay in system.delays]

    def at(self, delays: Sequence[float]) -> Loop:
        """Return the same for other delays [s]."""
        return Loop(with_delays(self.system, delays), self.order, self.gamma)

    def is_feasible(self, K: Gain) -> bool:
        """Whether the solver finds the analysis LMI of K feasible."""
        centre = self._margin(K)
        return centre is not None and centre[0] > 0

    def improved_gain(self, K: Gain, at: Loop | None = None) -> tuple[float, Gain] | None:
        """Return (margin, gain) for the delays of `at`, designed with the multipliers of K here."""
        centre = self._margin(K)
        if centre is None:
            return None
        lmi = GainLmi((at or self).system, self.order, K, self.gamma)
        return rounded(lmi.central(multiplier_of(centre[1], self.system), self.gamma))

    def initial_gains(self) -> list[Gain]:
        """Return the gains found with scalar multipliers."""
        gains = []
        for scale in SCALES:
            multipliers = scalar_multiplier(scale * max(self._delays), self.system)
            K = np.zeros(self.system.B.T.shape)
            lmi = GainLmi(self.system, self.order, K, self.gamma)
            proposal = rounded(lmi.central(multipliers, self.gamma))
            if proposal is not None and proposal[0] > 0:
                gains.append(proposal[1])
        return gains

    def _margin(self, K: Gain) -> tuple[float, Proof] | None:
        lmi = Condition(self.system, K, self.order, performance=self.gamma is not None)
        return lmi.margin(self._delays, self.gamma)


def continue_gain(
    loop_at: Callable[[float], Loop], K: Gain, start: float, end: float
) -> list[tuple[float, Gain]]:
    """Follow a gain from the parameter value `start` towards `end`: (value, gain) per step.

    `loop_at` gives the loop at a value (a delay, a share of all delays); K is feasible at `start`.
    """
    passed, factor, tries = [(start, K)], 2.0, 0
    while passed[-1][0] < end and factor > 1 + _SMALLEST_STEP and tries < _TRIES:
        tries += 1
        at, K = passed[-1]
        there = min(at * factor, end)
        improved = loop_at(at).improved_gain(K, loop_at(there))
        if improved is not None and improved[0] > 0 and loop_at(there).is_feasible(improved[1]):
            passed.append((there, improved[1]))
            factor = min(factor**1.5, 2.0)
        elif loop_at(there).is_feasible(K):
            passed.append((there, K))
        else:
            factor = float(np.sqrt(factor))
    return passed


def rounded(proposal: tuple[float, Gain] | None) -> tuple[float, Gain] | None:
    """Return (value, gain) with the gain rounded."""
    return None if proposal is None else (proposal[0], rounded_gain(proposal[1]))


def _scalar_gains(system: DelaySystem, order: int) -> list[Gain]:
    """Return the gains of least gamma with scalar multipliers."""
    gains = []
    longest = max(delay.d for delay in system.delays)
    K: Gain = np.zeros(system.B.T.shape)
    size = float(np.linalg.norm(system.D1, 2)) or 1.0
    for scale in SCALES:
        multipliers = scalar_multiplier(scale * longest, system)
        first = GainLmi(system, order, K, size).least_gamma(multipliers)
        if first is not None:
            lmi = GainLmi(system, order, K, first[0])
            middle = rounded(lmi.central(multipliers, _WELL_ABOVE * first[0]))
            if middle is not None and middle[0] > 0:
                gains.append(middle[1])
    return gains


def _continued(loop: Loop) -> list[Gain]:
    """Return a gain for the delays of `loop`, by continuation from short delays; [] if it ends."""
    lengths = np.array([delay.d for delay in loop.system.delays])
    short = loop.at((_SHORT * lengths).tolist())
    for K in short.initial_gains()[:1]:
        share, last = continue_gain(lambda s: loop.at((s * lengths).tolist()), K, _SHORT, 1.0)[-1]
        if share == 1.0:
            return [last]
    return []


def _descended(
    system: DelaySystem,
    order: int,
    starts: Sequence[Gain],
    goal: float | None,
    *,
    rounds: int = _ROUNDS,
    enough: float = _ENOUGH,
) -> list[Gain]:
    """Return gains of decreasing gamma from the best start, best first; stop below `goal`."""
    delays = [delay.d for delay in system.delays]

    def least(K: Gain, reference: float) -> float:
        lmi = Condition(system, K, order, performance=True)
        return lmi.least_gamma(delays, reference) or np.inf

    size = float(np.linalg.norm(system.D1, 2)) or 1.0
    ranked = sorted(((least(K, size), K) for K in starts), key=lambda pair: pair[0])
    ranked = [pair for pair in ranked if np.isfinite(pair[0])]
    for _ in range(rounds):
        if not ranked or (goal is not None and ranked[0][0] < goal):
            break
        gamma, K = ranked[0]
        with suppress(np.linalg.LinAlgError):
            for better in _round(system, order, gamma, K):
                value = least(better, gamma)
                if value < gamma:
                    ranked.insert(0, (value, better))
                    break
        if ranked[0][0] > (1 - enough) * gamma:
            break
    return [K for _, K in ranked]


def _round(system: DelaySystem, order: int, gamma: float, K: Gain) -> Iterator[Gain]:
    """Yield gains of less gamma, by the multipliers of K, away from the edge.

    Only the first that is there by a margin; else those near the edge, which an analysis judges.
    """
    delays = [delay.d for delay in system.delays]
    analysis = Condition(system, K, order, performance=True)
    proved = analysis.margin(delays, (1 + _ABOVE) * gamma)
    if proved is None:
        return
    multipliers = multiplier_of(proved[1], system)
    lmi = GainLmi(system, order, K, gamma)
    least = lmi.least_gamma(multipliers)
    if least is None or least[0] >= gamma:
        return
    at_edge: list[Gain] = []
    for share in _SHARES:
        level = max(least[0] + share * (gamma - least[0]), (1 + _ABOVE / 4) * least[0])
        middle = rounded(lmi.central(multipliers, level))
        if middle is not None and middle[0] > 0:
            yield middle[1]
            return
        at_edge += [] if middle is None else [middle[1]]
    yield from reversed(at_edge)


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
