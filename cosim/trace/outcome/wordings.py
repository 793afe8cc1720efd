"""What is said of each assumption of a guarantee: one table of its words and its numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from cosim.trace.outcome.feedback_age import age_lines, measurement_age_lines

Numbers = Callable[[Any, Mapping[str, Any]], str]
"""Whether it was met, and the metrics of the run, to the numbers behind it."""
AGE_OF: Final = "age_of_"
"""What the name of an assumption about the age of one measurement begins with."""
_SITES = {"u": "surge", "v": "sway", "w": "heave", "r": "yaw rate", "psi": "heading"}

_MEASUREMENTS = {
    "_within_design": "{} were no older than designed for",
    "_not_below_least": "{} were never newer than the proof assumes",
    "_sampled": "{} came into use at the age of the proof",
    "_constant": "The proof covers an age of {} that varies",
}
"""End of an assumption about the age of one measurement -> its words."""


def words_of(name: str, met: Any, metrics: Mapping[str, Any]) -> tuple[str, str]:
    """Return an assumption in words, and its numbers."""
    if name in WORDINGS:
        words, numbers = WORDINGS[name]
        return words, numbers(met, metrics)
    if name.startswith(AGE_OF) and name != AGE_OF:
        return _measurement_words(name.removeprefix(AGE_OF), met, metrics)
    return name.replace("_", " ").capitalize(), _plain("met", "not met")(met, metrics)


def number_in(metrics: Mapping[str, Any], key: str) -> float | None:
    """Return a metric if it is a number."""
    value = metrics.get(key)
    return float(value) if isinstance(value, int | float) and _is_number(value) else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(met: str, unmet: str = "") -> Numbers:
    """Return what is said where it was met, and where not."""
    return lambda was_met, _: met if was_met is True else unmet


def _aged(which: int) -> Numbers:
    """Return what was assumed, and a line of `age_lines` of the metric `feedback_age`."""

    def numbers(_: Any, metrics: Mapping[str, Any]) -> str:
        age = metrics.get("feedback_age")
        lines = age_lines(age) if isinstance(age, Mapping) else []
        return "; ".join(lines[:1] + lines[which : which + 1]) or "not measured"

    return numbers


def _measurement_words(name: str, met: Any, metrics: Mapping[str, Any]) -> tuple[str, str]:
    """Return an assumption about the age of one measurement, or of commands, and its numbers."""
    ages = metrics.get("measurement_ages")
    lines = measurement_age_lines(ages) if isinstance(ages, Mapping) else {}
    for end, words in _MEASUREMENTS.items():
        of = name.removesuffix(end)
        if of != name:
            subject = "Commands" if of == "commands" else f"Measurements of {of}"
            return words.format(subject), lines.get(of, "met" if met is True else "not met")
    return name.replace("_", " "), "met" if met is True else "not met"


def _age(met: Any, metrics: Mapping[str, Any]) -> str:
    age, designed = number_in(metrics, "message_age_s"), number_in(metrics, "designed_age_s")
    if age is None or designed is None:
        return "no measurement was ever in use"
    text = f"oldest in use {age:.6g} s, designed for any age up to {designed:.6g} s"
    known = metrics.get("feedback_age")
    assumed = known.get("assumed") if isinstance(known, Mapping) else None
    if isinstance(assumed, str) and not assumed.startswith("any age up to"):
        text = f"oldest in use {age:.6g} s, designed for {assumed}"
    if designed == 0.0:
        text = f"oldest in use {age:.6g} s, designed for feedback without delay"
    older = "departures" not in metrics  # a trace of an earlier version does not say more
    if older and met is not True and age <= designed * (1 + 1e-12):
        return text + "; but a link used a substitute for lost or too old messages"
    return text


def _envelope(_: Any, metrics: Mapping[str, Any]) -> str:
    use = metrics.get("envelope_use")
    shares = {k: v for k, v in (use if isinstance(use, dict) else {}).items() if _is_number(v)}
    if not shares:
        return "not measured"
    return "largest use of the bounds: " + ", ".join(
        f"{_SITES.get(axis, axis)} {'beyond all numbers' if v >= 1e300 else f'{100 * v:.3g} %'}"
        for axis, v in sorted(shares.items(), key=lambda item: -item[1])
    )


def _limits(met: Any, metrics: Mapping[str, Any]) -> str:
    fraction = number_in(metrics, "saturated_fraction")
    if fraction is None:
        return "not measured"
    if fraction == 0.0 and met is not True:
        return "not in this run, but in the run from the zero state, which measures the gain"
    if fraction == 0.0:
        return "at a limit during none of the time"
    return f"at a limit during {100 * fraction:.3g} % of the time"


WORDINGS: Final[Mapping[str, tuple[str, Numbers]]] = {
    "message_age_within_design": ("Measurements were no older than designed for", _age),
    "state_inside_envelope": ("The state stayed inside the envelope of the proof", _envelope),
    "limits_not_reached": ("No command stood at its limit", _limits),
    "certificate_verified": (
        "The certificate is valid",
        _plain(
            "every inequality of the proof was checked again in exact rational arithmetic",
            "the exact check fails",
        ),
    ),
    "claim_known": ("Every word of the claim has a rule", _plain("met", "a word is not known")),
    "observer_knows_commands": (
        "The observer knew the commands that acted",
        _plain(
            "what the plant received is what the observer took to act, at every point",
            "what the plant received was not always what the observer took to act",
        ),
    ),
    "loop_as_designed": (
        "The loop is the one designed for",
        _plain(
            "every input of the loop reads what the design says, over links alone",
            "a sensor, a map or a computed value stands between plant and controller",
        ),
    ),
    "plant_as_designed": (
        "The plant is the one designed for",
        _plain(
            "every parameter of the plant is that of the design's model",
            "the plant of the run has other parameters than the design's model",
        ),
    ),
    "controller_as_designed": (
        "The controller is the one designed",
        _plain(
            "gain, observer, maps and trim are those of the design",
            "the controller of the run has other numbers than the design",
        ),
    ),
    "sensors_as_designed": (
        "The sensors err no more than designed for",
        _plain("noise within what the design counts with, and no bias"),
    ),
    "values_delivered": (
        "Inputs of the loop had the values that were sent",
        _plain("compared at every point"),
    ),
    "plant_follows_law": (
        "The plant moved by the equations of the design",
        _plain("steps of the run against finer ones, among them those with the greatest changes"),
    ),
    "controller_follows_law": (
        "The controller commanded what the design says",
        _plain("compared at every point with the K of the design"),
    ),
    "measurements_true": (
        "Measurements were the state at their stamps, with the noise of the design",
        _plain("compared packet by packet"),
    ),
    "nothing_set_or_overridden": (
        "Nothing set or overridden",
        _plain(
            "events changed set-points, disturbances and links alone, if anything",
            "an event changed the loop",
        ),
    ),
    "message_age_not_below_least": (
        "Measurements were never newer than the proof assumes",
        _aged(1),
    ),
    "message_age_sampled": ("Every measurement came into use at the age of the proof", _aged(1)),
    "message_age_constant": ("The proof covers an age that varies", _aged(1)),
    # of older traces
    "links_justify_sampled_age": ("By their settings the links give a sampled age", _aged(2)),
}
"""Assumption -> its words, and what gives its numbers."""
