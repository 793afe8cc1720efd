"""The greatest delay by analyses that are sharper than Theorem 2, of gains designed for it.

Theorem 2 finds a delay for ages of any variation and a gain for it. An analysis of this gain, with
what is known of the ages and at a higher order, certifies more (`certified_delays`). At a delay a
little beyond, a design with the same conditions proposes the next gain, while that certifies more.
"""

from __future__ import annotations

from collections.abc import Callable

from cosim.core import InputError, NotAchievableError
from cosim.hinf.problem import ages_are_known, with_delay
from cosim.hinf.synthesis.analysis import Order
from cosim.hinf.synthesis.certified_delays import certified_delay
from cosim.hinf.synthesis.delay_result import GreatestDelay
from cosim.hinf.synthesis.result import Result
from cosim.models import DelaySystem, Matrix

_ROUNDS = 3
_BEYOND = 1.1  # delay at which the next gain is designed, as a multiple of the greatest
_WORTH = 1.01  # a longer delay by less ends the rounds


def improved_delay(
    system: DelaySystem,
    gamma: float | None,
    start: GreatestDelay | None,
    design_at: Callable[[DelaySystem], Result],
    *,
    delay_index: int,
    limit: float,
    order: Order,
) -> GreatestDelay | None:
    """Return a greatest delay beyond `start`; `start` itself where none is found.

    Parameters
    ----------
    system, gamma, delay_index, limit : as in `greatest_delay`.
    start : a greatest delay to begin with; None: a design at the system's own delay.
    design_at : designs a gain with `gamma` for the system at another delay.
    order : of the analysis.
    """
    best = start
    K: Matrix | None = None if start is None else start.result.K
    for _ in range(_ROUNDS):
        try:
            if K is None:
                at = system if best is None else _at(system, delay_index, best.delay or 0.0, limit)
                K = design_at(at).K
            certified = certified_delay(
                system, K, gamma, delay_index=delay_index, order=order, limit=limit
            )
        except (NotAchievableError, InputError):  # also a delay below the least age
            break
        K = None
        if certified.delay is None or (
            best is not None and certified.delay < _WORTH * (best.delay or 0.0)
        ):
            # no proof reaches further for ages of any variation alone
            if best is not start or not ages_are_known(system):
                break
            continue
        best = certified
        if certified.limit_reached:
            break
    return best


def _at(system: DelaySystem, delay_index: int, d: float, limit: float) -> DelaySystem:
    return with_delay(system, delay_index, min(_BEYOND * d, limit))
