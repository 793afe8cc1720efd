"""Runs, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Column
from rich.text import Text

from cosim.cli.terminal import NONE, TONES, facts, number, plain, table
from cosim.core import counted
from cosim.trace import outcome as outcomes
from cosim.trace.outcome import age_lines, measurement_age_lines

if TYPE_CHECKING:
    from cosim.scenario import Demo, Outcome

_LEVELS = {"warning": "yellow", "error": "red", "fatal": "red"}
_MOST_EVENTS = 12


def outcome_view(outcome: Outcome, *, details: bool = False) -> RenderableType:
    """Show what the answer of a run rests on: why it ended so, its figures, what happened.

    details : every assumption, not only those that were not met.
    """
    colour = TONES[outcome.tone]
    took = outcomes.duration_words(outcome.simulated_s, outcome.wall_s, outcome.steps)
    done = f"{outcome.title}: {took}"
    parts: list[RenderableType] = [Text(done, style="dim")]
    if outcome.explanation:
        parts.append(Text(outcome.explanation, style=colour))
    if outcome.cause is not None:
        parts.append(Text(f"cause: {outcome.cause.words}"))
    parts += _guarantee(outcome)
    outages = outcome.metrics.get("outages")
    parts += [*_assertions(outcome), *_advice(outcome)]
    parts += [
        facts(
            *(row for row in outcomes.key_figures(outcome.metrics) if row[1] != NONE),
            *(() if outages is None else outcomes.outage_rows(outages)),
        ),
        *_cut(outcome.metrics.get("cut_connections", ())),
        *_pace(outcome),
        *_links(outcome.links),
        _assumptions(outcome, details=details),
        *_age(outcome.metrics),
        *_outages(outages),
        *_events(outcome),
    ]
    if outcome.binaries:
        parts.append(Text(f"binaries: {outcome.binaries_text}"))
    if outcome.design is not None:
        parts.append(Text(f"design: {outcome.design.words}"))
    parts += late_view(outcome.log_after_end)
    if outcome.trace is not None:
        parts.append(Text(f"trace: {outcome.trace}"))
    return Group(*parts)


def late_view(log_after_end: Iterable[Mapping[str, str]]) -> list[RenderableType]:
    """Show warnings and errors that slaves logged after the trace was complete."""
    words = "{level}, not in the trace: {name}: {message}".format_map
    serious = (line for line in log_after_end if line["level"] not in {"debug", "info"})
    return [Text(words(line), style="yellow") for line in serious]


def demo_view(demo: Demo, *, details: bool = False) -> RenderableType:
    """Show both runs of the demo side by side, and what the guarantee does not cover.

    details : what the guarantee of each rests on, not only what was not met.
    """
    outcomes = list(demo.outcomes.values())
    rows: list[Iterable[str | Text]] = [("status", *map(_status, outcomes))]
    rows += (
        (figures[0][0], *(value for _, value in figures))
        for figures in zip(*map(_compared, outcomes), strict=True)
        if any(value != NONE for _, value in figures)
    )
    for name in outcomes[0].links:
        links = [outcome.links[name] for outcome in outcomes]
        counts = (f"{s['delivered']} of {s['sent']}" for s in links)
        rows.append((f"{name}: messages that arrived", *counts))
    title = "One vehicle, one sea, one late link; two designs"
    compared = table(("", *(f">{label}" for label in demo.outcomes)), rows, title)
    compared.pad_edge = True
    picture = f"none; {demo.no_picture}" if demo.picture is None else str(demo.picture)
    parts: list[RenderableType] = [Text.assemble("picture: ", (picture, "bold")), compared]
    for label, outcome in demo.outcomes.items():
        parts += _covered(label, outcome, details=details)
    if not details:
        parts.append(Text("\nall assumptions, and what each rests on: cosim demo --details", "dim"))
    return Group(*parts)


def demo_line(demo: Demo) -> str:
    """Say of each design whether its guarantee holds, and where the vehicle ends."""
    return "; ".join(map(_in_short, demo.outcomes, demo.outcomes.values()))


def _in_short(label: str, outcome: Outcome) -> str:
    """Say in half a sentence whether the guarantee of a run holds, and where the vehicle ends."""
    verdict = outcomes.guarantee_of(outcome, outcomes.assumptions_of(outcome))
    holds = outcome.headline if verdict is None else verdict.half_sentence
    error = outcome.metrics["position_error_m"]
    ended = "" if error is None else f", {error:.2g} m off at the end"
    return f"{label}: {holds}{ended}"


def _compared(outcome: Outcome) -> list[tuple[str, str]]:
    """Return rows of (figure and how it was obtained, value) that runs are compared by."""
    ages = outcome.metrics.get("measurement_ages") or {}
    own = {f"oldest {name} used" for name in ages}
    listed = outcomes.key_figures(outcome.metrics)
    rows = [(f"{what}, {how}", value) for what, value, how in listed if what not in own]
    for name, age in ages.items():
        most = None if age["measured"] is None else age["measured"]["greatest_s"]
        rows.append((f"oldest {name} used, measured", number(most, 4, "s")))
        rows.append((f"  certified up to, {name}", number(age["greatest_s"] or None, 4, "s")))
    return rows


def _covered(label: str, outcome: Outcome, *, details: bool) -> list[RenderableType]:
    """Say which assumptions were not met and why; with `details` of each what it rests on."""
    checks = outcomes.assumptions_of(outcome)
    verdict = outcomes.guarantee_of(outcome, checks)
    checks = [check for check in checks if details or check.tone != "good"]
    if not checks:
        return []
    lines = [Text()]
    if verdict is not None:
        lines.append(Text(f"{label}: {verdict.what}; {verdict.why}", "bold"))
    rows = (
        (_tick(check.tone == "good"), Text.assemble(check.what, "\n", (check.why, "dim")))
        for check in checks
    )
    return [*lines, table((), rows)]


def _cut(cut: Iterable[Mapping[str, Any]]) -> list[RenderableType]:
    """Show the connections that cut algebraic loops of unknown feedthrough."""
    words = "{from} -> {to} is delayed by one step ({delay_s:g} s): it closes an algebraic loop"
    lines = [words.format_map(each) for each in cut]
    if lines:
        lines.append(
            "if these outputs do not depend on inputs at once, feedthrough in [components] says so"
        )
    return [Text(line, style="yellow") for line in lines]


def _pace(outcome: Outcome) -> list[RenderableType]:
    """Show how well the run kept to --pace."""
    kept = outcome.pace
    if kept is None:
        return []
    late = f"{kept.late} of {kept.points} points were later than the next one was due"
    worst = f"at most {kept.largest_s:.3g} s late, {kept.mean_s:.3g} s on average"
    return [Text(f"{kept.factor:g} x real time: {late}; {worst}")]


_ON_MEDIUM = ("collided", "receiver_sending", "out_of_range")


def _links(links: Mapping[str, Mapping[str, Any]]) -> list[RenderableType]:
    if not links:
        return []
    buffered = any(s.get("late") is not None for s in links.values())
    late = ("late",) if buffered else ()
    fates = [fate for fate in _ON_MEDIUM if any(s.get(fate) for s in links.values())]
    named = [fate.replace("_", " ") for fate in (*late, *fates)]
    columns = ("sent", "delivered", "dropped", *named, "mean delay", "max delay", "max age")
    rows = (
        (
            name,
            *(str(s[key]) for key in ("sent", "delivered", "dropped")),
            *(number(s.get(key), 12) for key in (*late, *fates)),
            *(number(s[key], 4, "s") for key in ("mean_delay_s", "max_delay_s", "max_age_s")),
        )
        for name, s in links.items()
    )
    return [table(("link", *(f">{column}" for column in columns)), rows)]


def _guarantee(outcome: Outcome) -> list[RenderableType]:
    """Say whether the guarantee is claimed."""
    found = outcomes.guarantee_of(outcome, outcomes.assumptions_of(outcome))
    if found is None:
        return []
    verdict = Text(f"{found.what}: {found.why}", style=TONES[found.tone])
    return [verdict, *(Text(f"{label}: {words}") for label, words, _ in outcomes.facts_of(outcome))]


def _assumptions(outcome: Outcome, *, details: bool) -> RenderableType:
    """Show which assumptions were not met, and where; with `details` those that were as well."""
    if not outcome.assumptions:
        return Text(
            "no design: nothing is guaranteed ([design] file in the scenario names one)",
            style="dim",
        )
    rows, why = [], outcome.departures
    met_ones = sum(met is True for met in outcome.assumptions.values())
    for name, met in outcome.assumptions.items():
        if met is True and not details:
            continue
        words = Text(name.replace("_", " "))
        if name in why:
            words.append(f"\n{outcomes.departures_text(why[name])}", style="dim")
        rows.append((_tick(met), words))
    if met_ones and not details:
        rows.append((_tick(met=True), Text(f"{counted(met_ones, 'assumption')} (--details)")))
    return table((), rows, "Assumptions of the guarantee")


def _age(metrics: Mapping[str, Any]) -> list[RenderableType]:
    """Show which ages the guarantee assumes, which the run had, and what its settings justify."""
    age, each = metrics.get("feedback_age"), metrics.get("measurement_ages")
    lines = [] if age is None else age_lines(age)
    if each is not None:
        lines += [f"age of {name}: {line}" for name, line in measurement_age_lines(each).items()]
    return [Text(line) for line in lines]


def _outages(outages: Mapping[str, Any] | None) -> list[RenderableType]:
    """Show what holds across outages in place of gamma."""
    if outages is None:
        return []
    tone, words, numbers = outcomes.outage_verdict(outages)
    return [Text(f"{words}: {numbers}", style=TONES[tone])]


def _assertions(outcome: Outcome) -> list[RenderableType]:
    """Show the assertions and their verdicts."""
    if not outcome.assertions:
        return []
    rows = []
    for verdict in outcome.assertions:
        style = "green" if verdict.as_expected else "red"
        rows.append(
            (Text(f"{verdict.summary}{verdict.place}", style), verdict.name or verdict.words)
        )
    return [table((), rows, "Assertions")]


def _events(outcome: Outcome) -> list[RenderableType]:
    """Show what happened during the run, and how often."""
    if not outcome.events:
        return []
    rows: list[tuple[str, str | Text]] = []
    for event in outcome.events[:_MOST_EVENTS]:
        words = plain(" ".join(event.words.split()))
        words.stylize(_LEVELS.get(event.level, ""))
        rows.append((f"{event.first_s:g} s", words))
    if len(outcome.events) > _MOST_EVENTS:
        rows.append(("", f"and {len(outcome.events) - _MOST_EVENTS} more (cosim trace info)"))
    columns = Column(justify="right", no_wrap=True), Column(overflow="fold")
    return [table(columns, rows, "What happened")]


def _advice(outcome: Outcome) -> list[RenderableType]:
    """Say what to do about what is often overlooked."""
    lines = [
        f"try: {name} delivered none of its {s['sent']} messages: its delay may be longer than the "
        'run; a delay is in seconds, or has a unit: "400 ms"'
        for name, s in outcome.links.items()
        if s["sent"]
        and not s["delivered"]
        and s["dropped"] < s["sent"]
        and not any(s.get(fate) for fate in _ON_MEDIUM)
    ]
    age, designed = outcome.metrics["message_age_s"], outcome.metrics["designed_age_s"]
    if age is not None and designed is not None and age > designed * (1 + 1e-12):
        lines.append(
            f"try: a design for measurements {age:.4g} s old: [[system.delays]] with d, "
            "feedback = true and any_age = true in the file of the system, or [design] loop_delay "
            "of the system auv; cosim age shows what each age costs"
        )
    return [Text(line) for line in lines]


def _status(outcome: Outcome) -> Text:
    return Text(outcome.headline, style=TONES[outcome.tone])


def _tick(met: bool | None) -> Text:  # noqa: FBT001 - a formatter of one value
    if met is None:
        return Text(NONE)
    return Text("met", style="green") if met else Text("not met", style="red")
