"""The same system with other delays, with more or less that is known of its ages, or certain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cosim.core import InputError, counted
from cosim.models import Delay, DelaySystem

DELAY_LIMIT = 20.0
"""Where a search for the greatest delay ends [s]."""


def with_delay(system: DelaySystem, delay_index: int, d: float) -> DelaySystem:
    """Return the same system with delay `delay_index` replaced by d [s]."""
    return with_delays(
        system, [d if j == delay_index else x.d for j, x in enumerate(system.delays)]
    )


def with_delays(system: DelaySystem, lengths: Sequence[float]) -> DelaySystem:
    """Return the same system with other delays [s].

    Raises
    ------
    InputError : not one number per delay, or a negative one.
    """
    if len(lengths) != len(system.delays):
        raise InputError(
            "the delays do not fit the system",
            where="delays",
            expected=f"{counted(len(system.delays), 'number')} of seconds",
            got=str(list(lengths)),
        )
    try:
        delays = tuple(replace(x, d=d) for d, x in zip(lengths, system.delays, strict=True))
    except ValueError as error:
        raise InputError(str(error), where="delays") from error
    return replace(system, delays=delays)


def with_ages(
    system: DelaySystem, least_ages: Sequence[float] | None = None, *, sampled: bool = False
) -> DelaySystem:
    """Return the same system with more that is known of its ages.

    Parameters
    ----------
    least_ages : least age of each delay [s], 0 where nothing is known or the delay is constant.
    sampled : the age of the feedback is a sampled one.

    Raises
    ------
    InputError : not one number per delay, no feedback over a delay, or an impossible age.
    """
    least = [x.least_age for x in system.delays] if least_ages is None else list(least_ages)
    if len(least) != len(system.delays):
        raise InputError(
            "the least ages do not fit the system",
            where="least_ages",
            expected=f"{counted(len(system.delays), 'number')} of seconds",
            got=str(least),
        )
    if sampled and system.immediate_feedback:
        raise InputError(
            "the feedback has no age that could be sampled",
            where="sampled",
            expected="a delay that is the feedback",
            got="feedback without a delay",
        )
    try:
        delays = tuple(
            replace(x, least_age=a, sampled=x.sampled or (sampled and bool(x.feedback)))
            for a, x in zip(least, system.delays, strict=True)
        )
    except ValueError as error:
        raise InputError(str(error), where="least_ages") from error
    return replace(system, delays=delays)


def ages_are_known(system: DelaySystem) -> bool:
    """Whether more is known of an age than its bound."""
    return any(delay.ages_are_known for delay in system.delays)


def of_any_age(system: DelaySystem, share: float = 1.0) -> DelaySystem:
    """Return the system with its known ages of any variation, up to `share` of their bounds."""
    delays = (
        Delay(share * x.d, x.A, x.H, x.feedback, any_age=True) if x.ages_are_known else x
        for x in system.delays
    )
    return replace(system, delays=tuple(delays))


def without_uncertainty(system: DelaySystem) -> DelaySystem:
    """Return the nominal system: E and every H removed."""
    delays = tuple(replace(x, H=x.H[:0]) for x in system.delays)
    E, H = system.E[:, :0], system.H[:0]
    return replace(system, E=E, H=H, delays=delays, uncertainty_blocks=None)
