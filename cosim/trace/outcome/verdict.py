"""Judge a run by its outcome: status, gain against gamma, assumptions, assertions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim.core import at_most
from cosim.trace.outcome.feedback_age import age_lines, measurement_age_lines
from cosim.trace.outcome.outages import outage_rows, outage_verdict
from cosim.trace.outcome.run_outcome import BAD, CONTRADICTION, GOOD, OPEN, RunOutcome

_NAMED = 3
"""Places that are named one by one."""
_SITES = {"u": "surge", "v": "sway", "w": "heave", "r": "yaw rate", "psi": "heading"}


@dataclass(frozen=True)
class Statement:
    """A statement about the run: its tone (good, bad, open), and the numbers behind it.

    Attributes
    ----------
    at : when it was decided [s]; kind : the assertion itself, where `what` is its name.
    """

    tone: str
    what: str
    why: str
    at: float | None = None
    kind: str = ""


def status_of(info: Mapping[str, Any], outcome: RunOutcome | None) -> Statement:
    """Return how the run ended; `info` : what `describe` says of the file."""
    found = _status_of(info, outcome)
    recovered = info["recovered"]
    if recovered is None:
        return found
    return replace(found, why=f"{found.why} {recovered['words']}".strip())


def _status_of(info: Mapping[str, Any], outcome: RunOutcome | None) -> Statement:
    if not info["complete"]:
        return Statement(BAD, "cut short", f"The file ends early or is damaged: {info['damage']}.")
    if outcome is None:
        if not info["run"]:
            return Statement(
                OPEN, "recording", "Not a run of this project: signals without a verdict."
            )
        return Statement(
            BAD, "did not finish", "There is no result: the run stopped before its end."
        )
    return Statement(outcome.tone, outcome.headline, outcome.explanation)


def guarantee_of(
    outcome: RunOutcome, checks: list[Statement], verified: Mapping[str, Any] | None = None
) -> Statement | None:
    """Judge whether the certified bound may be claimed; None where nothing was certified.

    checks : the assumptions, as from `assumptions_of`.
    verified : of `describe`, for an outcome that a file tells: what fails its own check claims
        nothing.
    """
    if not checks:
        return None
    if verified is not None and verified["verdict"] == "failed":
        why = f"the file fails its own check: {'; '.join(verified['failed'][:1])}"
        return Statement(BAD, "The guarantee is not claimed", why)
    if outcome.contradiction is not None:
        words = CONTRADICTION.format(outcome.contradiction)
        return Statement(BAD, "The run contradicts its guarantee", words)
    gain, gamma = _number(outcome.metrics, "gain"), _number(outcome.metrics, "gamma")
    measured = "no gain was measured"
    if gain is not None and gamma is not None:
        measured = f"measured gain {gain:.4g}, certified bound γ = {at_most(gamma, 5)}"
        if gain > gamma:
            return Statement(BAD, "The measured gain is above γ", measured)
    broken = [check for check in checks if check.tone == BAD]
    if broken:
        return _not_claimed(outcome, checks, broken, measured)
    if gain is None and gamma is not None and outcome.metrics.get("disturbed") is False:
        measured = f"no disturbance acted: the bound γ = {at_most(gamma, 5)} was not exercised"
    return Statement(GOOD, "The guarantee holds for this run", f"every assumption met; {measured}")


def _not_claimed(
    outcome: RunOutcome, checks: list[Statement], broken: list[Statement], measured: str
) -> Statement:
    """Return what holds where assumptions were not met: the bounds across outages, or nothing."""
    outages = outcome.metrics.get("outages")
    by_age = [
        check
        for check, name in zip(checks, outcome.assumptions, strict=True)
        if check.tone == BAD and name == "message_age_within_design"
    ]
    if isinstance(outages, Mapping) and broken == by_age:
        return Statement(*outage_verdict(outages))
    count = f"{len(broken)} of {len(checks)} assumptions"
    return Statement(BAD, "The guarantee is not claimed", f"{count} not met; {measured}")


def facts_of(
    outcome: RunOutcome, verified: Mapping[str, Any] | None = None
) -> Iterator[tuple[str, str, str]]:
    """Yield the label, the value, and how it is known, of the facts under the verdict."""
    for fact in outcome.facts:
        yield fact.label, fact.text, fact.known
    if verified is not None and outcome.assumptions:
        words = {"ok": "whole and unchanged", "failed": "; ".join(verified["failed"][:1])}
        yield "this file", words.get(verified["verdict"], verified["verdict"]), "verified now"


def assumptions_of(outcome: RunOutcome) -> list[Statement]:
    """Return the certificate's assumptions, each with the numbers behind it."""
    metrics = outcome.metrics
    return [
        Statement(
            GOOD if met is True else BAD if met is False else OPEN,
            *_with_departures(outcome.departures.get(name, ()), name, *_words(name, met, metrics)),
        )
        for name, met in outcome.assumptions.items()
    ]


def departures_text(departures: Sequence[Mapping[str, Any]]) -> str:
    """Return why an assumption was not met: place, what was expected, what was got, and when."""
    each = []
    for one in departures[:_NAMED]:
        at = _number(one, "at_s")
        since = "" if at is None else f", first at {at:.6g} s"
        each.append(f"{one.get('place')}: {one.get('got')}; expected {one.get('expected')}{since}")
    more = len(departures) - _NAMED
    return ". ".join(each) + (f". And {more} more" if more > 0 else "")


def _with_departures(
    departures: Sequence[Mapping[str, Any]], name: str, what: str, why: str
) -> tuple[str, str]:
    """Return the words of an assumption with the places where it was not met.

    Of the envelope and the limits the figures of the whole run say it; of the age they do unless
    they are within the design: then the first measurement was late, or one was substituted.
    """
    if not departures or name in ("state_inside_envelope", "limits_not_reached"):
        return what, why
    if name == "message_age_within_design" or (
        name.startswith(_OF) and name.endswith("_within_design")
    ):
        beside = [one for one in departures if not str(one.get("got", "")).endswith(" s")]
        return what, f"{why}; {departures_text(beside)}" if beside else why
    return what, departures_text(departures)


def assertions_of(outcome: RunOutcome) -> list[Statement]:
    """Return the scenario's assertions, failed ones first."""
    return [
        Statement(
            OPEN if each.result == "undecided" else GOOD if each.as_expected else BAD,
            each.name or each.words,
            each.summary,
            each.at_s,
            each.words if each.name else "",
        )
        for each in sorted(outcome.assertions, key=lambda each: each.as_expected)
    ]


def figures_of(metrics: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield the label, the value, and how it was obtained, of further figures of the run.

    They are those beside gain, norm and bound, and beside the numbers of the assumptions.
    """
    assumed = metrics.get("assumptions")
    listed = assumed if isinstance(assumed, dict) else {}
    for key, label, unit, how, within in (
        ("norm_reached", "gain / exact norm", "%", "measured / computed", ""),
        ("position_error_m", "final position error", "m", "measured", ""),
        ("message_age_s", "oldest measurement used", "s", "measured", "message_age_within_design"),
        ("saturated_fraction", "time at a limit", "%", "measured", "limits_not_reached"),
        ("abscissa", "spectral abscissa", "1/s", "computed, nominal loop", ""),
        ("coupling_delay_s", "delay the coupling adds", "s", "measured, beyond the links", ""),
    ):
        value = _number(metrics, key)
        if value is None or within in listed or (key == "coupling_delay_s" and value == 0.0):
            continue
        formatted = f"{100 * value:.4g} %" if unit == "%" else f"{value:.5g} {unit}".strip()
        yield label, formatted, how
    outages = metrics.get("outages")
    if isinstance(outages, Mapping):
        yield from outage_rows(outages)
    for cut in metrics.get("cut_connections") or ():
        late = f"{cut.get('delay_s', 0.0):.5g} s"
        yield f"delay added to {cut.get('from')} -> {cut.get('to')}", late, "unknown feedthrough"


def _words(name: str, met: Any, metrics: Mapping[str, Any]) -> tuple[str, str]:
    """Return an assumption in words, and its numbers."""
    match name:
        case "message_age_within_design":
            return "Measurements were no older than designed for", _age(met, metrics)
        case "state_inside_envelope":
            return "The state stayed inside the envelope of the proof", _envelope(metrics)
        case "limits_not_reached":
            return "No command stood at its limit", _limits(met, metrics)
    if name in _COMPARED:
        what, same, other = _COMPARED[name]
        return what, same if met is True else other
    if name.startswith(_OF) and name != _OF:
        return _measurement_words(name.removeprefix(_OF), met, metrics)
    words, line = _AGES.get(name, (name.replace("_", " ").capitalize(), None))
    plain = "met" if met is True else "not met"
    return words, plain if line is None else _age_line(metrics, line)


_COMPARED = {
    "certificate_verified": (
        "The certificate is valid",
        "every inequality of the proof was checked again in exact rational arithmetic",
        "the exact check fails",
    ),
    "claim_known": ("Every word of the claim has a rule", "met", "a word is not known"),
    "observer_knows_commands": (
        "The observer knew the commands that acted",
        "what the plant received is what the observer took to act, at every point",
        "what the plant received was not always what the observer took to act",
    ),
    "loop_as_designed": (
        "The loop is the one designed for",
        "every input of the loop reads what the design says, over links alone",
        "a sensor, a map or a computed value stands between plant and controller",
    ),
    "plant_as_designed": (
        "The plant is the one designed for",
        "every parameter of the plant is that of the design's model",
        "the plant of the run has other parameters than the design's model",
    ),
    "controller_as_designed": (
        "The controller is the one designed",
        "gain, observer, maps and trim are those of the design",
        "the controller of the run has other numbers than the design",
    ),
    "sensors_as_designed": (
        "The sensors err no more than designed for",
        "noise within what the design counts with, and no bias",
        "",
    ),
    "values_delivered": (
        "Inputs of the loop had the values that were sent",
        "compared at every point",
        "",
    ),
    "plant_follows_law": (
        "The plant moved by the equations of the design",
        "steps of the run against finer ones, among them those with the greatest changes",
        "",
    ),
    "controller_follows_law": (
        "The controller commanded what the design says",
        "compared at every point with the K of the design",
        "",
    ),
    "measurements_true": (
        "Measurements were the state at their stamps, with the noise of the design",
        "compared packet by packet",
        "",
    ),
    "nothing_set_or_overridden": (
        "Nothing set or overridden",
        "events changed set-points, disturbances and links alone, if anything",
        "an event changed the loop",
    ),
}
"""Assumption -> its words, and what is said where it was met and where not."""

_AGES: dict[str, tuple[str, int | None]] = {
    "message_age_not_below_least": ("Measurements were never newer than the proof assumes", 1),
    "message_age_sampled": ("Every measurement came into use at the age of the proof", 1),
    "message_age_constant": ("The proof covers an age that varies", 1),
    # of older traces
    "links_justify_sampled_age": ("By their settings the links give a sampled age", 2),
}
"""Assumption -> its words, and the line of `age_lines` with its numbers."""


_OF = "age_of_"
_MEASUREMENTS = {
    "_within_design": "{} were no older than designed for",
    "_not_below_least": "{} were never newer than the proof assumes",
    "_sampled": "{} came into use at the age of the proof",
    "_constant": "The proof covers an age of {} that varies",
}
"""End of an assumption about the age of one measurement -> its words."""


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


def _age_line(metrics: Mapping[str, Any], which: int) -> str:
    """Return what was assumed, and the line of the metric `feedback_age` that tells of it."""
    age = metrics.get("feedback_age")
    lines = age_lines(age) if isinstance(age, Mapping) else []
    return "; ".join(lines[:1] + lines[which : which + 1]) or "not measured"


def _age(met: Any, metrics: Mapping[str, Any]) -> str:
    age, designed = _number(metrics, "message_age_s"), _number(metrics, "designed_age_s")
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


def _envelope(metrics: Mapping[str, Any]) -> str:
    use = metrics.get("envelope_use")
    shares = {k: v for k, v in (use if isinstance(use, dict) else {}).items() if _is_number(v)}
    if not shares:
        return "not measured"
    return "largest use of the bounds: " + ", ".join(
        f"{_SITES.get(axis, axis)} {'beyond all numbers' if v >= 1e300 else f'{100 * v:.3g} %'}"
        for axis, v in sorted(shares.items(), key=lambda item: -item[1])
    )


def _limits(met: Any, metrics: Mapping[str, Any]) -> str:
    fraction = _number(metrics, "saturated_fraction")
    if fraction is None:
        return "not measured"
    if fraction == 0.0 and met is not True:
        return "not in this run, but in the run from the zero state, which measures the gain"
    if fraction == 0.0:
        return "at a limit during none of the time"
    return f"at a limit during {100 * fraction:.3g} % of the time"


def _number(metrics: Mapping[str, Any], key: str) -> float | None:
    value = metrics.get(key)
    return float(value) if isinstance(value, int | float) and _is_number(value) else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
