"""Designs and greatest delays of order N, started from the gain of Theorem 2, proved exactly."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from numpy.typing import ArrayLike

from cosim.core import NotAchievableError
from cosim.hinf.nominal import NominalFigures, WorstCase, one_thread, worst_case_at
from cosim.hinf.synthesis.analysis import Analysis, analyse
from cosim.hinf.synthesis.bessel_legendre_loop import Gain, Loop, continue_gain
from cosim.hinf.synthesis.bessel_legendre_synthesis import bessel_legendre_gain, check_order
from cosim.hinf.synthesis.greatest_delays import (
    DELAY_LIMIT,
    GreatestDelay,
    greatest_delay,
    with_delay,
)
from cosim.hinf.synthesis.ladder import delays_below, first_proved
from cosim.hinf.synthesis.not_achievable import hint_after
from cosim.hinf.synthesis.synthesis import Design, check_achievable, design
from cosim.models import DelaySystem

_SHORT = 2.0**-10  # first delay tried where Theorem 2 certifies none, as a share of the limit


@one_thread
def bessel_legendre_design(
    system: DelaySystem,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    order: int,
    gamma: float | None = None,
    gain: ArrayLike | None = None,
    search: bool = False,
    starts: Sequence[Gain] | None = None,
) -> Design:
    """Design a gain as `synthesis.design` does, proved with the inequality of order N.

    Parameters
    ----------
    starts : gains to start from; None: that of Theorem 2.
    k1, k2 : of the gain of Theorem 2 that the design starts from; not used by the proof.
    order : N. Order 0 covers every constant delay up to the system's, as Theorem 2 does. A
        higher order does so where that can be proved at the same gamma, otherwise it covers
        exactly these delays (`Design.covers_smaller_delays`). A delay of any age has order 0.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no gain could be certified.
    """
    if gamma is not None:
        check_achievable(gamma, system)
    check_order(order, system)
    if gain is not None:
        return given_gain_design(system, gain, gamma, order)
    if starts is None:
        starts = []
        with suppress(NotAchievableError):  # the LMI of order N has other starts as well
            starts = [design(system, k1, k2, search=search).K]
    return as_design(bessel_legendre_gain(system, order, starts, gamma))


@one_thread
def bessel_legendre_delay(
    system: DelaySystem,
    gamma: float | None,
    k1: Sequence[float],
    k2: Sequence[float],
    *,
    order: int,
    delay_index: int = 0,
    limit: float = DELAY_LIMIT,
    search: bool = False,
) -> GreatestDelay:
    """Find the greatest delay as `greatest_delays.greatest_delay` does, with order N.

    Continuation from the gain at the greatest delay of Theorem 2; nothing is refuted beyond
    the end. At N > 0 the proof covers exactly that delay, or every one up to it
    (`Design.covers_smaller_delays`).

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no delay at all can be certified.
    """

    def at(d: float) -> Loop:
        return Loop(with_delay(system, delay_index, d), order, gamma)

    try:
        plain = greatest_delay(
            system, gamma, k1, k2, delay_index=delay_index, limit=limit, search=search
        )
        K, start = plain.design.K, plain.delay
    except NotAchievableError as error:
        start = _SHORT * limit
        short = at(start).initial_gains()
        if not short:
            raise error from None
        K = short[0]
    check_order(order, at(start).system)
    passed = continue_gain(at, K, start, limit)
    end, K = passed[-1]

    def prove(tried: tuple[float, Gain]) -> tuple[GreatestDelay | None, str]:
        d, gain = tried
        try:
            found = analyse(at(d).system, gain, gamma, order=order)
        except NotAchievableError as error:  # a loop too fast for its roots to be counted
            return None, error.what
        if not found.certified:
            return None, str(found.reason)
        return GreatestDelay(d, as_design(found), d == limit, None, None), ""

    below = [(d, K) for d in delays_below(end, itself=True)]
    greatest, reason = first_proved([*below, *reversed(passed[:-1])], prove)
    if greatest is not None:
        return greatest
    raise NotAchievableError(
        f"no delay could be certified at order {order}",
        where=system.name or None,
        expected=f"an exact proof near d = {end:.6g}, the greatest delay by the solver",
        got=reason,
        hint="another order, a larger gamma",
    )


def given_gain_design(
    system: DelaySystem, gain: ArrayLike, gamma: float | None, order: int
) -> Design:
    """Return the design of a given gain: its analysis, which must be certified.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : it is not.
    """
    found = analyse(system, gain, gamma, order=order)
    if not found.certified:
        raise NotAchievableError(
            f"this gain could not be certified at order {order}",
            where=system.name or None,
            expected="an exact proof" if gamma is None else f"a proof of gamma = {gamma:g}",
            got=found.reason,
            hint=hint_after(str(found.reason), "a larger gamma, another order"),
        )
    return as_design(found)


def as_design(found: Analysis, worst_case: WorstCase | None = None) -> Design:
    """Return the design of a proved gain; `worst_case` where it is known."""
    if found.K is None or found.certificate is None:
        raise ValueError("expected a proved gain, got an analysis without")
    return Design(
        system=found.system,
        K=found.K,
        gamma=found.gamma,
        k1=(),
        k2=(),
        least_gamma=found.least_gamma,
        certificate=found.certificate,
        order=found.order,
        worst_case=worst_case or worst_case_at(found.system, found.K, found.norm_frequency),
        **{name: getattr(found, name) for name in NominalFigures._fields},
    )
