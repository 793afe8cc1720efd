"""Remark 3 for a given loop: the greatest delay at which stability, or a gamma, is certified.

Every certified delay has an exact proof. "Not certified beyond" means that no proof was found
there, not that the loop is unstable there.

A proof of order 0 (Theorem 1) covers every constant delay up to its own, so the greatest delay
is found by bisection. A proof of higher order first covers exactly one delay: the search goes
up from the greatest delay of order 0 in steps of `_STEP`, to the end of that feasible interval
(a gap shorter than a step is not seen), and then tries one proof for every delay up to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.hinf.delay_lti import figures_if_known
from cosim.hinf.lmi import Condition
from cosim.hinf.problem import DELAY_LIMIT, with_delay
from cosim.hinf.synthesis.analysis import (
    Order,
    check_gamma,
    check_order_of_analysis,
    gain_of,
)
from cosim.hinf.synthesis.conditions import (
    affordable_conditions,
    affordable_order,
    conditions_of,
    is_large,
    prove,
    widened,
)
from cosim.hinf.synthesis.delay_result import GreatestDelay
from cosim.hinf.synthesis.delay_routes import check_delay
from cosim.hinf.synthesis.result import Result
from cosim.models import DelaySystem

_STEP = 1.1
_FROM_KNOWN = 1.5  # first step from an age that is known to be certified, or nearly so
_FIRST = 2.0**-10  # first delay tried above zero, as a share of the limit
PRECISION = 1e-6
"""Of the bisection, relative."""


def certified_delay(
    system: DelaySystem,
    gain: ArrayLike | None = None,
    gamma: float | None = None,
    *,
    delay_index: int = 0,
    order: Order = "auto",
    limit: float = DELAY_LIMIT,
    precision: float = PRECISION,
) -> GreatestDelay:
    """Find the greatest delay `delay_index` at which u = K x is certified, the others kept.

        >>> from cosim import link
        >>> from cosim.hinf import DelaySystem, certified_delay
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]], delays=[link(0.1)])
        >>> found = certified_delay(system, [[-1.0]], order=0)
        >>> 0.9 < found.delay < 1.1, found.result.certified
        (True, True)

    Parameters
    ----------
    system : Eq. (7).
    gain : (m, n) K; None for u = 0.
    gamma : bound of the gain from w to z; None for stability alone.
    delay_index : index of the delay.
    order : of the Bessel-Legendre inequality, 0 for Theorem 1; "auto": the greatest affordable.
    limit : where the search stops [s].
    precision : of the bisection, relative.

    Raises
    ------
    InputError : numbers that do not fit the system.
    """
    K = gain_of(system, gain)
    check_delay(system, delay_index, limit)
    check_order_of_analysis(order)
    if gamma is not None:
        check_gamma(gamma, system)
    own_order = order
    if own_order == "auto":
        own_order = affordable_order(system, K, performance=gamma is not None)
    search = _searched(system, K, gamma, delay_index, own_order, limit, precision)
    search.widen()
    done = search.d is not None and search.d >= limit
    system_at_d = system if search.d is None else search.at(search.d)
    none = f"no delay was found at which a proof exists; at {search.failed} s: {search.reason}"
    result = Result(
        system=system_at_d,
        K=K,
        order=own_order if search.d is None else search.order,
        reason=none if search.d is None else None,
        gamma=None if search.d is None else gamma,
        certificate=search.certificate,
        figures=figures_if_known(system_at_d, K)[0],
    )
    beyond = None if done or search.d is None else search.failed
    return GreatestDelay(delay_index, search.d, result, done, not_certified_at=beyond)


def certified_age(
    system: DelaySystem,
    K: NDArray[np.float64],
    gamma: float | None,
    *,
    delay_index: int,
    limit: float,
    precision: float,
    known: float | None,
) -> tuple[float | None, bool]:
    """Return the age [s] that `certified_delay` finds, and whether it is the limit.

    By quick conditions alone, and without the figures of the loop.

    known : an age that is likely to be certified, to begin with.
    """
    order = affordable_order(system, K, performance=gamma is not None)
    search = _searched(
        system, K, gamma, delay_index, order, limit, precision, quick=True, known=known
    ).d
    return search, search is not None and search >= limit


def _searched(
    system: DelaySystem,
    K: NDArray[np.float64],
    gamma: float | None,
    delay_index: int,
    order: int,
    limit: float,
    precision: float,
    *,
    quick: bool = False,
    known: float | None = None,
) -> _Search:
    search = _Search(system, K, gamma, delay_index, precision, quick=quick)
    is_constant = order and not system.delays[delay_index].any_age
    if known is not None and known < limit:
        rough = _STEP - 1 if is_constant else 0.0
        search.climb(
            0 if is_constant else order, limit, start=known, step=_FROM_KNOWN, precision=rough
        )
    if is_constant:
        if search.d is None:
            search.climb(0, limit, start=0.0, step=2.0, precision=_STEP - 1)
        if search.d != limit:
            search.climb(order, limit, start=search.d or 0.0, step=_STEP)
        if search.d is not None and search.d != limit and search.order != order:
            search.climb(0, limit, start=search.d, step=_STEP)
        if search.d is None:
            # some loops need their delay
            search.climb(order, limit, start=system.delays[delay_index].d, step=_STEP)
    elif search.d is None:
        # an age is greater than its least value
        least = system.delays[delay_index].least_age
        start = least + _FIRST * (limit - least) if least else 0.0
        search.climb(order, limit, start=start, step=2.0)
    return search


class _Search:
    """The greatest certified delay so far (`d`), and the least failed one (`failed`)."""

    def __init__(
        self,
        system: DelaySystem,
        K: NDArray[np.float64],
        gamma: float | None,
        delay_index: int,
        precision: float,
        *,
        quick: bool,
    ) -> None:
        self._quick = quick
        self._system, self._K, self._gamma, self._which = system, K, gamma, delay_index
        self._precision, self._large = precision, is_large(system, K)
        self.d: float | None = None
        self.failed: float | None = None
        self.order = 0
        self.reason: str | None = None
        self.certificate: dict[str, Any] | None = None

    def at(self, d: float) -> DelaySystem:
        """Return the system with the delay that is searched replaced by d [s]."""
        return with_delay(self._system, self._which, d)

    def widen(self) -> None:
        """Replace the proof by one for every delay up to the greatest, where there is one."""
        if self.d is not None:
            condition = self._conditions(self.order)[0]
            wide = widened(condition, self.at(self.d), self._K, self._gamma)
            self.certificate = wide or self.certificate

    def _conditions(self, order: int) -> list[Condition]:
        how: Any = {"performance": self._gamma is not None, "large": self._large}
        if self._quick:
            # those that compare gains: many delays are tried
            affordable = affordable_conditions(self._system, self._K, order, ranking=True, **how)
            if affordable:
                return affordable
        return conditions_of(self._system, self._K, order, **how)

    def climb(
        self, order: int, limit: float, *, start: float, step: float, precision: float = 0.0
    ) -> None:
        """Go up from `start` until a proof fails or the limit is reached, then bisect."""
        conditions = self._conditions(order)
        self.failed = None

        def certified(d: float) -> bool:
            reasons = []
            for condition in conditions:
                proof, reason = prove(
                    condition, self.at(d), self._K, self._gamma, is_search=self._quick
                )
                if proof is not None:
                    conditions[:] = [condition]  # kept for the other delays
                    self.d, self.order, self.certificate = d, order, proof
                    return True
                reasons.append(reason)
            self.failed, self.reason = d, reasons[0]
            return False

        d = min(start, limit)
        if d != self.d and not certified(d):
            return
        while d < limit and self.failed is None:
            d = min(max(float(f"{d * step:.10g}"), limit * _FIRST), limit)
            certified(d)
        while (
            self.failed is not None
            and self.d is not None
            and self.failed - self.d > max(precision, self._precision) * self.failed
        ):
            certified(_between(self.d, self.failed))


def _between(low: float, high: float) -> float:
    """Return the middle, rounded to as few digits as the interval needs."""
    middle = (low + high) / 2
    digits = 1 - int(np.floor(np.log10(high - low)))
    rounded = round(middle, digits)
    return rounded if low < rounded < high else middle
