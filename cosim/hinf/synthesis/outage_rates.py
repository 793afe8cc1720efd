"""Find and prove the rates of a loop whose link drops out.

A line search in alpha, each with the least beta by bisection, so that the share of time in touch
that is needed is least. `cosim.hinf.certificate.outage_guarantee` has the functional and proves
the rates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError
from cosim.hinf import lmi
from cosim.hinf.certificate import Outages, outage_delay
from cosim.hinf.delay_lti import checked_system, one_thread
from cosim.hinf.synthesis.analysis import check_gamma, gain_of
from cosim.hinf.synthesis.result import Result
from cosim.models import DelaySystem

if TYPE_CHECKING:
    from cosim.models import Matrix

_SHARES = (0.1, 0.3, 0.55, 0.8)
"""Of the greatest alpha: the first round of the line search."""
_CLOSE = 1.005  # of two values of beta between which the bisection ends
_ABOVE = (1.002, 1.01, 1.05, 1.2)  # of the least beta, where a proof is tried
_MOST = 24  # steps of a bracket: a factor of 2 each
_TIMES_GAMMA = 2.0
"""Weighted gain that is asked for by default, of the certified gamma: it leaves room for alpha."""


@one_thread
def certified_outages(
    system: DelaySystem,
    gain: ArrayLike,
    *,
    gamma: float | None = None,
    alpha: float | None = None,
    fallback: ArrayLike | None = None,
    fallback_age: float = 0.0,
) -> Outages:
    """Prove how fast a loop decays in touch, and how fast it may grow out of touch.

    Parameters
    ----------
    system : Eq. (7), u = K x(t - d) over one link; ages of it count as any age up to d.
    gain : (m, n) K.
    gamma : bound of the gain from w to z, weighted across outages; None: stability alone.
    alpha : rate of decay in touch [1/s]; None: the one with the least share of time in touch.
    fallback : (m, n) gain of what acts by age d, on board; None: zero input.
    fallback_age : greatest age of what the fallback acts on [s]; 0: it acts at once.

    Raises
    ------
    InputError : numbers that do not fit the system, or a system without such a link.
    NotAchievableError : nothing could be proved.

    Examples
    --------
    >>> from cosim.hinf import Delay, DelaySystem
    >>> from cosim.hinf.synthesis import certified_outages
    >>> loop = DelaySystem(
    ...     A=[[0, 1], [0, -0.1]], B=[[0], [0.1]],
    ...     delays=[Delay(0.5, [[0, 0], [0, 0]], feedback=True, any_age=True)],
    ... )
    >>> found = certified_outages(loop, [[-3.75, -11.5]])
    >>> float(found.share) < 0.44
    True
    """
    system = checked_system(system, control=True)
    K = gain_of(system, gain)
    back = np.zeros_like(K) if fallback is None else gain_of(system, fallback)
    feedback = outage_delay(system)
    if gamma is not None:
        check_gamma(gamma, system)
    if not 0 <= fallback_age <= feedback.d:
        raise InputError(
            "the fallback acts on what is older than the feedback may be",
            where="fallback_age",
            expected=f"0 to {feedback.d:g} s",
            got=f"{fallback_age:g} s",
        )
    if alpha is not None and not (np.isfinite(alpha) and alpha > 0):
        raise InputError("not a rate of decay", where="alpha", expected="a positive number of 1/s")
    search = _Search(system, K, gamma, back, fallback_age)
    with lmi.solver_words() as words:
        outages = search.least_share() if alpha is None else search.at(_decimal(alpha))
    if outages is None:
        raise NotAchievableError(
            "no rate of decay was found while the link is up, with a rate of growth in outages",
            where=system.name or None,
            expected=f"feedback of any age up to {feedback.d:g} s that can be proved stable"
            + ("" if gamma is None else f" with a weighted gain of {gamma:g}"),
            got=lmi.not_found(words) if search.reason is None else search.reason,
            hint="a shorter age, a smaller alpha, a greater gamma; or a gain for this age",
        )
    return outages


def with_outages(
    proved: Result,
    *,
    gamma: float | None = None,
    alpha: float | None = None,
    fallback: ArrayLike | None = None,
    fallback_age: float = 0.0,
) -> Result:
    """Return a certified design or analysis that also proves what holds across outages.

    Parameters
    ----------
    gamma : weighted gain; None: twice the certified gamma, where there is one.
    alpha, fallback, fallback_age : as of `certified_outages`.

    Raises
    ------
    InputError, NotAchievableError : as `certified_outages`; an analysis without a certificate.
    """
    if proved.certificate is None or not proved.K.any():
        raise InputError("there is no certified gain", where="proved", expected="a proof of a gain")
    if gamma is None and proved.gamma is not None:
        gamma = float(f"{_TIMES_GAMMA * proved.gamma:.4g}")
    outages = certified_outages(
        proved.system,
        proved.K,
        gamma=gamma,
        alpha=alpha,
        fallback=fallback,
        fallback_age=fallback_age,
    )
    more = replace(proved.guarantees, outages=outages)
    return replace(proved, guarantees=more, certificate=more.beside(proved.certificate))


class _Search:
    """The search for rates of one loop."""

    def __init__(
        self,
        system: DelaySystem,
        K: Matrix,
        gamma: float | None,
        fallback: Matrix,
        fallback_age: float,
    ) -> None:
        self._system, self._K, self._gamma = system, K, gamma
        self._lmi = lmi.OutageLmi(system, K, fallback, fallback_age)
        self._delays = [delay.d for delay in system.delays]
        self.reason: str | None = None

    def least_share(self) -> Outages | None:
        """Return the proof of the least share of time in touch."""
        top = self._greatest_alpha()
        if top is None:
            return None
        tried: dict[float, tuple[float, float]] = {}
        for share in _SHARES:
            self._try(share * top, tried)
        for _ in range(2):
            if not tried:
                break
            for alpha in _between(tried):
                self._try(alpha, tried)
        for alpha in sorted(tried, key=lambda a: tried[a]):
            outages = self.at(_decimal(alpha), tried[alpha][1])
            if outages is not None:
                return outages
        return None

    def _try(self, alpha: float, tried: dict[float, tuple[float, float]]) -> None:
        beta = self._least_beta(_decimal(alpha))
        if beta is not None:
            tried[alpha] = beta / (alpha + beta) if beta > 0 else 0.0, beta

    def at(self, alpha: Fraction, beta: float | None = None) -> Outages | None:
        """Return the proof at this alpha, with about the least beta."""
        beta = self._least_beta(alpha) if beta is None else beta
        if beta is None:
            return None
        step = max(abs(beta), 1e-3 * float(alpha))
        for above in _ABOVE:
            rounded = _decimal(beta + (above - 1) * step)
            self._lmi.set_rates(alpha, max(rounded, -alpha))
            point = self._lmi.central(self._gamma)
            if point is None:
                continue
            self.reason = point.failure(self._system, self._K)
            if self.reason is None:
                return point
        return None

    def _feasible(self, alpha: Fraction, beta: Fraction | None) -> bool:
        self._lmi.set_rates(alpha, beta)
        return self._lmi.is_met(self._gamma)

    def _greatest_alpha(self) -> float | None:
        """Return about the greatest alpha that the loop in touch allows; None: none is found."""
        alpha = 0.1 / max(self._delays)
        there = self._feasible(_decimal(alpha), None)
        factor = 2.0 if there else 0.5
        for _ in range(_MOST):
            if self._feasible(_decimal(alpha * factor), None) != there:
                break
            alpha *= factor
        else:
            return None
        low, high = sorted((alpha, alpha * factor))
        while high / low > 1.05:
            middle = (low * high) ** 0.5
            low, high = (middle, high) if self._feasible(_decimal(middle), None) else (low, middle)
        return low

    def _least_beta(self, alpha: Fraction) -> float | None:
        """Return about the least beta at this alpha; None: none is found."""
        if self._feasible(alpha, Fraction(0)):
            return 0.0
        high = float(alpha)
        for _ in range(_MOST):
            if self._feasible(alpha, _decimal(high)):
                break
            high *= 2
        else:
            return None
        low = high / 2 if high > float(alpha) else 0.0
        while high > _CLOSE * low and high - low > 1e-3 * float(alpha):
            middle = (low + high) / 2
            low, high = (low, middle) if self._feasible(alpha, _decimal(middle)) else (middle, high)
        return high


def _between(tried: dict[float, tuple[float, float]]) -> Iterator[float]:
    """Yield an alpha on either side of the best one."""
    known = sorted(tried)
    best = known.index(min(tried, key=lambda a: tried[a]))
    yield (known[best] + known[best - 1]) / 2 if best else known[0] / 2
    if best + 1 < len(known):
        yield (known[best] + known[best + 1]) / 2


def _decimal(value: float) -> Fraction:
    """Return a short decimal near a number, exactly."""
    return Fraction(f"{value:.3g}")
