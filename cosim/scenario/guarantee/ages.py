"""Whether the ages of a run are those that a proof covers: rule by rule of its claim.

What is measured of a run (`MeasuredAges`) is compared with the rule of the word that the claim has
for each delay of the feedback, of a measurement, or of the commands (`claim.AGE_RULES`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from cosim import hinf
from cosim.scenario.age import MeasuredAges
from cosim.scenario.guarantee.claim import AgeRule, age_rule, word_of
from cosim.scenario.guarantee.departure import Departure

if TYPE_CHECKING:
    from cosim.models import Delay

_CLOSE = 1e-12
"""Relative: ages are doubles of whole nanoseconds."""
COMMANDS = "commands"

Findings = dict[str, list[Departure]]
"""Assumption -> why it is not met; empty where it is."""


class FedBack(NamedTuple):
    """States that are fed back with one age.

    Attributes
    ----------
    place : what is so old, for people.
    d, least : bounds of the age [s].
    word : of the claim.
    """

    place: str
    d: float
    least: float
    word: str


def feedback_findings(
    fed_back: FedBack,
    measured: MeasuredAges | None,
    proved_again: str,
    *,
    substituted: bool,
) -> Findings:
    """Return what a state feedback assumes of its age, by assumption.

    Parameters
    ----------
    proved_again : the command that proves the design for an age that varies.
    substituted : whether a link used a substitute for a lost message.
    """
    rule = age_rule(fed_back.word)
    late = list(_within(fed_back, measured, substituted=substituted))
    if fed_back.d == 0 and late and proved_again:
        late[0] = late[0]._replace(got=f"{late[0].got}: it is held; {proved_again}")
    found: Findings = {"message_age_within_design": late}
    if measured is not None and not measured.alike:
        expected = "one age for all of it: u = K x(t - age)"
        got = "parts of different ages at the same time"
        found["measurements_equally_old"] = [Departure(fed_back.place, expected, got)]
    if not rule.varies:
        if fed_back.d > 0:
            words = _constant_words(fed_back, measured, proved_again)
            found["message_age_constant"] = [Departure(fed_back.place, *words)]
        return found
    return found | _kind(fed_back, rule, measured)


def of_commands(greatest_ns: int | None, step_ns: int) -> MeasuredAges | None:
    """Return the ages of integrals that a controller keeps, from those of its commands.

    They are held as the commands are, and a command shows at the end of the step that made it.
    """
    if greatest_ns is None:
        return None
    greatest = greatest_ns + step_ns
    return MeasuredAges(None, greatest, None, 0, alike=True)


def measurement_findings(
    one: Delay,
    name: str,
    measured: MeasuredAges | None,
    proved_again: str,
    *,
    substituted: bool,
) -> Findings:
    """Return what an observer assumes of the age of one measurement, by assumption."""
    fed_back = FedBack(name, one.d, one.least_age, word_of(one))
    rule = age_rule(fed_back.word)
    start = f"age_of_{name}"
    found: Findings = {
        f"{start}_within_design": list(_within(fed_back, measured, substituted=substituted))
    }
    if not rule.varies:
        words = _constant_words(fed_back, measured, proved_again)
        return found | {f"{start}_constant": [Departure(name, *words)]}
    more = _kind(fed_back, rule, measured)
    return found | {f"{start}_{key.removeprefix('message_age_')}": x for key, x in more.items()}


def command_findings(
    pair: hinf.certificate.ObserverPair, greatest_ns: int | None, proved_again: str
) -> Findings:
    """Return what an observer assumes of the age of its commands, by assumption."""
    bound = pair.command_age
    within, constant = f"age_of_{COMMANDS}_within_design", f"age_of_{COMMANDS}_constant"
    if greatest_ns is None:
        return {within: [Departure(COMMANDS, f"at most {bound:g} s old", "none was ever in use")]}
    if not pair.command_any_age:
        words = f"proved for commands of a constant age, {bound:.9g} s"
        got = f"commands are held, up to {greatest_ns / 1e9:.9g} s old; {proved_again}"
        return {constant: [Departure(COMMANDS, words, got)]}
    late = greatest_ns / 1e9 > bound * (1 + _CLOSE)
    got = f"{greatest_ns / 1e9:.9g} s"
    return {within: [Departure(COMMANDS, f"at most {bound:.9g} s old", got)] if late else []}


def _within(
    fed_back: FedBack, measured: MeasuredAges | None, *, substituted: bool
) -> Iterator[Departure]:
    """Yield what was older than d: before the first measurement the time counts as its age."""
    expected, d = f"at most {fed_back.d:.9g} s old", fed_back.d * (1 + _CLOSE)
    if measured is None:
        yield Departure(fed_back.place, expected, "no measurement was ever in use")
        return
    if measured.greatest_ns / 1e9 > d:
        yield Departure(fed_back.place, expected, f"{measured.greatest_ns / 1e9:.9g} s")
    elif measured.first_ns / 1e9 > d:
        got = f"none until {measured.first_ns / 1e9:.9g} s after the start"
        yield Departure(fed_back.place, expected, got)
    if substituted or measured.interrupted:
        got = "a link used a substitute for lost or too old messages"
        yield Departure(fed_back.place, "a measurement in use at every time", got)


def _kind(fed_back: FedBack, rule: AgeRule, measured: MeasuredAges | None) -> Findings:
    """Return what a rule asks beside the greatest age."""
    if not rule.least or (fed_back.least == 0.0 and not rule.sampled):
        return {}
    least = None if measured is None else measured.least_ns
    expected = f"at least {fed_back.least:.9g} s old"
    below: list[Departure] = []
    if least is None:
        below.append(Departure(fed_back.place, expected, "no measurement came into use"))
    elif least / 1e9 < fed_back.least * (1 - _CLOSE):
        below.append(Departure(fed_back.place, expected, f"{least / 1e9:.9g} s"))
    found: Findings = {"message_age_not_below_least": below}
    if rule.sampled:
        found["message_age_sampled"] = list(_sampled(fed_back, measured))
    return found


def _sampled(fed_back: FedBack, measured: MeasuredAges | None) -> Iterator[Departure]:
    expected = f"exactly {fed_back.least:.9g} s old when it comes into use"
    if measured is None or measured.in_use_ns is None or not measured.alike:
        yield Departure(fed_back.place, expected, "not one age")
        return
    for age in measured.in_use_ns:
        if abs(age / 1e9 - fed_back.least) > _CLOSE * fed_back.d:
            yield Departure(fed_back.place, expected, f"{age / 1e9:.9g} s")
            return


def _constant_words(
    fed_back: FedBack, measured: MeasuredAges | None, proved_again: str
) -> tuple[str, str]:
    """Return what is expected of an age that is proved to be constant, and what it is."""
    most = "" if measured is None else f", up to {measured.greatest_ns / 1e9:.9g} s old"
    age = f"{fed_back.d:.9g} s, {fed_back.word}" if fed_back.d else "0 s: at once"
    return f"proved for a constant age ({age})", f"what is used is held{most}; {proved_again}"


def findings_of_all(each: Mapping[str, Findings]) -> Findings:
    """Return the findings of several feedback delays as one, each assumption met by all."""
    found: Findings = {}
    for findings in each.values():
        for name, departures in findings.items():
            found.setdefault(name, []).extend(departures)
    return found
