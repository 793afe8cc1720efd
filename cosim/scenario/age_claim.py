"""Which ages a design's proof is about, and whether a run had such ages; in figures and words.

The proof of a design is about one kind of age of the feedback (`cosim.models.Delay`): any up to d,
never less than least_age, sampled, or constant. Each demands more of a run than the one before.
"""

from __future__ import annotations

from typing import Any

from cosim.models import Delay, DelaySystem
from cosim.scenario.age import MeasuredAges
from cosim.scenario.feedback_age import FeedbackAge

_CLOSE = 1e-12
"""Relative: ages are doubles of whole nanoseconds."""


def feedback_of(system: DelaySystem) -> Delay | None:
    """Return the delay through which the control acts; None where it acts at once."""
    return next((delay for delay in system.delays if delay.feedback and delay.d > 0), None)


def age_in_words(delay: Delay) -> str:
    """Return which ages a proof is about."""
    if delay.sampled:
        return (
            f"sampled: exactly {delay.least_age:.6g} s when a measurement comes into use, growing "
            f"at rate one until the next one does, to {delay.d:.6g} s at most"
        )
    if not delay.any_age:
        return f"constant, up to {delay.d:.6g} s"
    span = f"from {delay.least_age:.6g} s to" if delay.least_age else "up to"
    return f"any age {span} {delay.d:.6g} s, however it varies"


def age_assumptions(
    delay: Delay | None, measured: MeasuredAges | None, known: FeedbackAge | None, step_ns: int
) -> dict[str, bool]:
    """Return what a proof assumes of the age beside its bound, and whether it was met, by name.

    Parameters
    ----------
    known : what the settings of the links say.
    step_ns : communication step [ns].
    """
    if delay is None or not (delay.ages_are_known or not delay.any_age):
        return {}
    if not delay.any_age:
        return {"message_age_constant": _is_constant(measured, step_ns)}
    found = {"message_age_not_below_least": _not_below(delay, measured)}
    if delay.sampled:
        found["message_age_sampled"] = _is_sampled(delay, measured)
        found["links_justify_sampled_age"] = known is not None and _justified(delay, known)
    return found


def age_figures(
    delay: Delay | None, measured: MeasuredAges | None, known: FeedbackAge | None
) -> dict[str, Any] | None:
    """Return the ages assumed, measured, and known from the settings, JSON-safe."""
    if delay is None:
        return None
    found: dict[str, Any] = {
        "assumed": age_in_words(delay),
        "least_s": delay.least_age,
        "greatest_s": delay.d,
        "sampled": delay.sampled,
        "measured": None,
        "settings": None,
    }
    if measured is not None:
        found["measured"] = {
            "least_s": None if measured.least_ns is None else measured.least_ns / 1e9,
            "greatest_s": measured.greatest_ns / 1e9,
            "in_use_s": [age / 1e9 for age in measured.in_use_ns or ()],
        }
    if known is not None:
        found["settings"] = {
            "least_s": known.least_ns / 1e9,
            "greatest_s": None if known.greatest_ns is None else known.greatest_ns / 1e9,
            "sampled": known.sampled,
            "why": known.why,
        }
    return found


def _not_below(delay: Delay, measured: MeasuredAges | None) -> bool:
    """Whether no age was below the least; before the first measurement, the time counts as age."""
    return (
        measured is not None
        and measured.least_ns is not None
        and measured.least_ns / 1e9 >= delay.least_age * (1 - _CLOSE)
        and measured.first_ns / 1e9 <= delay.d * (1 + _CLOSE)
    )


def _is_sampled(delay: Delay, measured: MeasuredAges | None) -> bool:
    return (
        measured is not None
        and measured.in_use_ns is not None
        and measured.alike
        and all(abs(age / 1e9 - delay.least_age) <= _CLOSE * delay.d for age in measured.in_use_ns)
    )


def _justified(delay: Delay, known: FeedbackAge) -> bool:
    return known.sampled and abs(known.least_ns / 1e9 - delay.least_age) <= _CLOSE * delay.d


def _is_constant(measured: MeasuredAges | None, step_ns: int) -> bool:
    """Whether the age varied by no more than the exchange at communication points makes it vary."""
    if measured is None or measured.least_ns is None:
        return False
    return measured.greatest_ns - measured.least_ns <= 2 * step_ns
