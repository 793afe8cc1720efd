"""Remark 3 for a given loop: the greatest delay at which stability, or a gamma, is certified.

Every delay that counts carries an exact proof; a delay that is "not certified beyond" is one
at which no proof was found, which does not say that the loop fails there.

Order 0 (Theorem 1) proves every constant delay up to the one it is proved for, so its greatest
delay is found by bisection. A higher order speaks of exactly one delay, at first: the search starts
from the greatest delay of order 0 and climbs in steps of `_STEP`, so that it ends at the end
of the feasible interval it started in, as far as such steps can see. There one proof for every
delay up to it is tried for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.hinf.analysis import (
    Analysis,
    Prover,
    check_gamma,
    check_order_of_analysis,
    gain_of,
)
from cosim.hinf.greatest_delays import DELAY_LIMIT, check_delay, with_delay
from cosim.hinf.nominal_figures import nominal_figures_of
from cosim.models import DelaySystem

_STEP = 1.1
_FIRST = 2.0**-10
"""First delay tried above zero, of the limit."""

_PRECISION = 1e-6
"""Of the bisection, relative."""


@dataclass(frozen=True, eq=False)
class CertifiedDelay:
    """The end of what is certified for one delay, the others held.

    Attributes
    ----------
    delay_index : index of the delay in `system.delays`.
    d : the greatest certified delay [s]; None if none is.
    not_certified_at : a delay just above d at which no proof was found; None at the limit, and
        without a d.
    limit_reached : the search stopped at its limit, with everything certified.
    analysis : at d, with its proof; of the system as given if nothing is certified. Its
        `covers_smaller_delays` says whether every smaller delay is covered. Its `order` is that of
        the proof.
    """

    delay_index: int
    d: float | None
    not_certified_at: float | None
    limit_reached: bool
    analysis: Analysis


def certified_delay(
    system: DelaySystem,
    gain: ArrayLike | None = None,
    gamma: float | None = None,
    *,
    delay_index: int = 0,
    order: int = 0,
    limit: float = DELAY_LIMIT,
) -> CertifiedDelay:
    """The greatest delay `delay_index` for which u = K x is certified, the other delays held.

    Parameters
    ----------
    system : Eq. (7).
    gain : (m, n) K; None for the system as it is.
    gamma : the gain from w to z to hold; None for stability alone.
    delay_index : index of the delay.
    order : of the Bessel-Legendre inequality, 0 for Theorem 1.
    limit : where the search stops [s].

    Raises
    ------
    InputError : numbers that do not fit the system.
    """
    K = gain_of(system, gain)
    check_delay(system, delay_index, limit)
    check_order_of_analysis(order)
    if gamma is not None:
        check_gamma(gamma, system)
    search = _Search(system, K, gamma, delay_index)
    if order and not system.delays[delay_index].any_age:
        search.climb(0, limit, start=0.0, step=2.0, precision=_STEP - 1)
        search.climb(order, limit, start=search.d or 0.0, step=_STEP)
        if search.d is not None and search.order != order:
            search.climb(0, limit, start=search.d, step=_STEP)
        if search.d is None:
            # some loops need their delay
            search.climb(order, limit, start=system.delays[delay_index].d, step=_STEP)
    else:
        search.climb(order, limit, start=0.0, step=2.0)
    search.widen()
    done = search.d is not None and search.d >= limit
    system_at_d = system if search.d is None else search.at(search.d)
    analysis = Analysis(
        system=system_at_d,
        K=None if gain is None else K,
        order=order if search.d is None else search.order,
        certified=search.d is not None,
        reason=None
        if search.d is not None
        else f"no delay was found at which a proof exists; at {search.failed:g} s: {search.reason}",
        gamma=None if search.d is None else gamma,
        least_gamma=None,
        certificate=search.certificate,
        **nominal_figures_of(system_at_d, K)._asdict(),
    )
    return CertifiedDelay(
        delay_index=delay_index,
        d=search.d,
        not_certified_at=None if done or search.d is None else search.failed,
        limit_reached=done,
        analysis=analysis,
    )


class _Search:
    """The greatest certified delay so far (`d`), and the least failed one (`failed`)."""

    def __init__(
        self, system: DelaySystem, K: NDArray[np.float64], gamma: float | None, delay_index: int
    ) -> None:
        self._system, self._K, self._gamma, self._which = system, K, gamma, delay_index
        self.d: float | None = None
        self.failed: float | None = None
        self.order = 0
        self.reason: str | None = None
        self.certificate: dict[str, Any] | None = None

    def at(self, d: float) -> DelaySystem:
        """Return the system with the delay that is searched replaced by d [s]."""
        return with_delay(self._system, self._which, d)

    def widen(self) -> None:
        """A proof for every delay up to the greatest, where there is one."""
        if self.d is not None:
            prover = Prover(self._system, self._K, self.order, self._gamma)
            self.certificate = prover.widened(self.at(self.d)) or self.certificate

    def climb(
        self, order: int, limit: float, *, start: float, step: float, precision: float = _PRECISION
    ) -> None:
        """From `start` upwards until a proof fails or the limit is reached, then bisect."""
        prover = Prover(self._system, self._K, order, self._gamma)
        self.failed = None

        def certified(d: float) -> bool:
            proof = prover.proof(self.at(d))
            if proof is None:
                self.failed, self.reason = d, prover.reason
            else:
                self.d, self.order, self.certificate = d, order, proof
            return proof is not None

        d = min(start, limit)
        if d != self.d and not certified(d):
            return
        while d < limit and self.failed is None:
            d = min(max(d * step, limit * _FIRST), limit)
            certified(d)
        while (
            self.failed is not None
            and self.d is not None
            and self.failed - self.d > precision * self.failed
        ):
            certified(_between(self.d, self.failed))


def _between(low: float, high: float) -> float:
    """The middle, to as few digits as the interval needs."""
    middle = (low + high) / 2
    digits = 1 - int(np.floor(np.log10(high - low)))
    rounded = round(middle, digits)
    return rounded if low < rounded < high else middle
