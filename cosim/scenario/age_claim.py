"""Which ages a design's proof is about, and which a run had; in figures and words.

The proof of a design is about one kind of age of the feedback (`cosim.models.Delay`): any up to d,
never less than least_age, sampled, or constant. An observer has such an age for each measurement,
and one for its commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cosim.models import Delay, DelaySystem
from cosim.scenario.age import MeasuredAges
from cosim.scenario.feedback_age import FeedbackAge

if TYPE_CHECKING:
    from cosim.hinf import Result

COMMANDS = "commands"
"""Entry of the figures, beside those of the measurements."""


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


def measurement_age_figures(
    design: Result, ages: Mapping[str, MeasuredAges | None], command_age_ns: int | None
) -> dict[str, Any]:
    """Return by measurement the ages assumed and measured, and those of the commands; JSON-safe."""
    n = len(design.system.A)
    found: dict[str, Any] = {
        each.name: age_figures(each.delay(n), ages.get(each.name), None)
        for each in design.measurements
    }
    measured = None if command_age_ns is None else {"greatest_s": command_age_ns / 1e9}
    age = design.pair.command_age
    kind = f"any age up to {age:.6g} s" if design.pair.command_any_age else f"constant, {age:.6g} s"
    found[COMMANDS] = {
        "assumed": f"{kind}, from the estimate to the end of its use",
        "greatest_s": age,
        "measured": measured,
    }
    return found
