"""Judge a run by its outcome: status, gain against gamma, assumptions, assertions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim.core import at_most
from cosim.trace.outcome.outages import outage_rows, outage_verdict
from cosim.trace.outcome.run_outcome import BAD, CONTRADICTION, GOOD, OPEN, RunOutcome
from cosim.trace.outcome.wordings import AGE_OF, number_in, words_of

_NAMED = 3
"""Places that are named one by one."""


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

    @property
    def half_sentence(self) -> str:
        """What it says, to stand behind other words."""
        return f"{self.what[0].lower()}{self.what[1:]}"


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
    gain, gamma = number_in(outcome.metrics, "gain"), number_in(outcome.metrics, "gamma")
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


def answer_of(
    name: str, outcome: RunOutcome, verified: Mapping[str, Any] | None = None
) -> Statement:
    """Say in one sentence how a run ended, against what was asked of it and what was proved.

    It is the first line of every view of a run.

    name : of the run.
    verified : as for `guarantee_of`.
    """
    reason = (outcome.reason or "").strip().partition("\n")[0]
    broken = [each for each in outcome.assertions if not each.as_expected]
    if outcome.contradiction is not None:
        reason = outcome.contradiction
    elif not reason and broken:
        reason = f"{broken[0].name or broken[0].words}{broken[0].place}"
    reason = reason.removeprefix(f"{outcome.status} ")  # as the headline has it
    parts = [": ".join(filter(None, (name, outcome.headline, reason))), _claim(outcome, verified)]
    return Statement(outcome.tone, "; ".join(filter(None, parts)), "")


def ended_of(info: Mapping[str, Any]) -> Statement:
    """Say in one sentence how the run in a file ended; `info` : what `describe` says of it."""
    known = info["outcome"]
    outcome = None if known is None else RunOutcome.from_json(known)
    name = info["run"].get("scenario") or Path(info["path"]).name
    state = status_of(info, outcome)
    if outcome is None or not info["complete"]:
        return Statement(state.tone, f"{name}: {state.what}: {state.why}", "")
    return answer_of(name, outcome, info.get("verified"))


def _claim(outcome: RunOutcome, verified: Mapping[str, Any] | None) -> str:
    """Say in half a sentence what a run may claim; "" of one that failed without a design."""
    found = guarantee_of(outcome, assumptions_of(outcome), verified)
    if found is None:
        finished = outcome.status == "finished"
        return "no design was named, so nothing is guaranteed" if finished else ""
    words = found.half_sentence
    gain, gamma = number_in(outcome.metrics, "gain"), number_in(outcome.metrics, "gamma")
    if gain is None or gamma is None or found.tone != GOOD:
        return words
    return f"{words} (gain {gain:.4g}, at most {at_most(gamma, 5)} proved)"


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
            *_with_departures(
                outcome.departures.get(name, ()), name, *words_of(name, met, metrics)
            ),
        )
        for name, met in outcome.assumptions.items()
    ]


def departures_text(departures: Sequence[Mapping[str, Any]]) -> str:
    """Return why an assumption was not met: place, what was expected, what was got, and when."""
    each = []
    for one in departures[:_NAMED]:
        at = number_in(one, "at_s")
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
        name.startswith(AGE_OF) and name.endswith("_within_design")
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
        value = number_in(metrics, key)
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
