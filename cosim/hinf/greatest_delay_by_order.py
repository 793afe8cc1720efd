"""The greatest delay by the condition that proves it: Theorem 2, or Bessel-Legendre of order N."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.hinf.bessel_legendre_designs import bessel_legendre_delay
from cosim.hinf.from_control import checked_system
from cosim.hinf.greatest_delays import (
    DELAY_LIMIT,
    GreatestDelay,
    greatest_delay as delay_of_theorem_2,
)
from cosim.hinf.search import initial_scalars
from cosim.models import DelaySystem


def greatest_delay(
    system: DelaySystem,
    gamma: float | None,
    k1: Sequence[float] | None = None,
    k2: Sequence[float] | None = None,
    *,
    delay_index: int = 0,
    limit: float = DELAY_LIMIT,
    search: bool | None = None,
    order: int | None = None,
) -> GreatestDelay:
    """The greatest delay `delay_index` at which gamma (None: stability) is certified.

    Parameters
    ----------
    system : the delays other than `delay_index` are held.
    gamma : bound of the gain from w to z; None for a system without w and z.
    k1, k2 : one number per delay; where searched, the first start. Without both, a search.
    delay_index : index of the delay.
    limit : where the search ends [s].
    search : look for better k1, k2 as well.
    order : None for Theorem 2, with what refutes it beyond; N for the sharper condition.

    Raises
    ------
    InputError : numbers that do not fit the system.
    NotAchievableError : no delay at all can be certified.
    """
    system = checked_system(system, control=True)
    one, two, look = initial_scalars(system, k1, k2, search)
    if order is None:
        return delay_of_theorem_2(
            system, gamma, one, two, delay_index=delay_index, limit=limit, search=look
        )
    return bessel_legendre_delay(
        system, gamma, one, two, order=order, delay_index=delay_index, limit=limit, search=look
    )
