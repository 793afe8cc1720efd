"""Format the summary of a trace as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Group
from rich.table import Table as RichTable
from rich.text import Text

from cosim.core import at_most
from cosim.trace.outcome.feedback_age import age_lines, measurement_age_lines
from cosim.trace.outcome.outages import outage_rows, outage_verdict
from cosim.trace.outcome.run_outcome import RunOutcome
from cosim.trace.outcome.verdict import (
    Statement,
    assumptions_of,
    departures_text,
    facts_of,
    guarantee_of,
    status_of,
)
from cosim.trace.rows.layout import HOST_PREFIX

_HEADLINES = ("title", "scenario", "seed", "software")
_FIGURES = {
    "gain": ("gain of the zero-state run", ""),
    "exact_norm": ("exact norm, nominal loop", ""),
    "gamma": ("gamma, certified", ""),
    "position_error_m": ("final position error", " m"),
    "saturated_fraction": ("share of time at a limit", ""),
    "message_age_s": ("oldest measurement used", " s"),
    "designed_age_s": ("age designed for", " s"),
}
_LINK_FIGURES = (
    *("sent", "delivered", "dropped", "late", "collided", "receiver_sending", "out_of_range"),
    *("mean_delay_s", "max_delay_s", "max_age_s"),
)
_WHERE_ANY = ("collided", "receiver_sending", "out_of_range")
_MOST_EVENTS = 20
_HOST = ("host.command", "host.started", "host.python", "host.platform")


def render(description: Mapping[str, Any], *, details: bool = True) -> Group:
    """Format a `describe` dictionary for rich to print.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import describe, render
        >>> from rich.console import Console
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> Console(color_system=None).print(render(describe("lag.mcap")))
        trace lag.mcap ...
        state finished
        ...

    description : as `describe` returns it.
    details : show FMUs, proof, attachments, assumptions and the signals of each topic; False: only
        how the run ended, what it can claim, and which topics there are.
    """
    topics = description["topics"]
    parts: list[Any] = [_facts(description, details=details)]
    if details:
        parts.append(_topics(topics))
    elif topics:
        listed = ", ".join(f"{topic['topic']} ({topic['count']})" for topic in topics)
        parts.append(_text(f"{len(topics)} topics (messages): {listed}"))
    if description["links"]:
        parts.append(_links(description["links"]))
    return Group(*parts)


def _text(value: object) -> Text:
    """Show text literally: no markup, and no control characters that a file may contain."""
    return Text("".join(c if c.isprintable() or c == "\n" else "\ufffd" for c in str(value)))


def _facts(description: Mapping[str, Any], *, details: bool) -> RichTable:
    facts = RichTable.grid(padding=(0, 2))
    facts.add_column(style="bold")
    facts.add_column(overflow="fold")
    known = description["outcome"]
    outcome = None if known is None else RunOutcome.from_json(known)
    for name, value in (
        *_identity(description, outcome, details=details),
        *(_certificate(description["certificate"]) if details else ()),
        *_guarantee(description, outcome or RunOutcome(), details=details),
        *_verdict(outcome or RunOutcome(), details=details),
    ):
        facts.add_row(_text(name), _text(value))
    has_events = outcome is not None and bool(outcome.events)
    for line in description["log"]:
        if not has_events or line["level"] in ("error", "fatal"):
            facts.add_row(
                _text(f"{line['level']} at {line['time_s']:g} s"),
                _text(f"{line['name']}: {line['message']}"),
            )
    for item in description["attachments"] if details else ():
        facts.add_row(
            Text("attached"), _text(f"{item['name']} ({item['media_type']}, {item['bytes']} bytes)")
        )
    return facts


def _identity(
    description: Mapping[str, Any], outcome: RunOutcome | None, *, details: bool
) -> Iterator[tuple[str, object]]:
    """Yield the facts that identify the run, how it ended, and what happened in it."""
    run = description["run"]
    yield "trace", f"{description['path']} ({description['bytes']} bytes)"
    yield from _ended(status_of(description, outcome), outcome or RunOutcome())
    if description["start_ns"] is not None:
        yield "time", f"{description['start_ns'] / 1e9:g} s to {description['end_ns'] / 1e9:g} s"
    yield from ((key, run[key]) for key in _HEADLINES if key in run)
    hashes = [key for key in sorted(run) if key.startswith("fmu.") and key.endswith(".sha256")]
    for key in hashes if details else ():
        name = key.removesuffix(".sha256")
        yield name, f"{run.get(name, '')}, SHA-256 {run[key][:16]}..."
    host = [f"{key.removeprefix(HOST_PREFIX)} {run[key]}" for key in sorted(run) if key in _HOST]
    if host and details:
        yield "recorded", ", ".join(host)
    none = "not computed: --hash reads the file for it"
    if description["content_hash_version"] is None:
        none = "none: the rows are of a format that a newer auv-cosim knows"
    yield "content hash", description["content_hash"] or none


def _ended(state: Statement, outcome: RunOutcome) -> Iterator[tuple[str, object]]:
    """Yield how the run ended and why, its assertions, and its events."""
    yield "state", state.what
    if state.why:
        yield "reason", state.why
    if outcome.cause is not None:
        yield "cause", outcome.cause.words
    for each in sorted(outcome.assertions, key=lambda each: each.as_expected):
        yield f"assertion {each.name or each.words}", each.summary + each.place
    for event in outcome.events[:_MOST_EVENTS]:
        yield f"{event.level} at {event.first_s:g} s", event.words
    if len(outcome.events) > _MOST_EVENTS:
        yield "", f"and {len(outcome.events) - _MOST_EVENTS} more (--json has all)"


def _certificate(certificate: Mapping[str, Any] | None) -> Iterator[tuple[str, object]]:
    """Yield what is proved about the gain of the run."""
    if certificate is None:
        return
    claim = certificate["claim"]
    if isinstance(claim, dict):
        yield "certificate", f"{claim.get('property')}{_gamma(claim.get('gamma'))}"
        delays = claim.get("delays")
        for delay in delays if isinstance(delays, list) else ():
            if isinstance(delay, dict):
                acts = ", the control acts through it" if delay.get("feedback") else ""
                yield "", f"d = {delay.get('d')} s: age {delay.get('age')}{acts}"
    yield "of the gain", certificate["gain"]
    yield "proof", f"{certificate['attachment']}, SHA-256 {str(certificate['sha256'])[:16]}..."


def _gamma(text: object) -> str:
    """Format the bound as a decimal number; the file has it exactly."""
    try:
        return f", gamma = {at_most(str(text))}"
    except (ValueError, ZeroDivisionError, OverflowError):
        return ""


def _guarantee(
    description: Mapping[str, Any], outcome: RunOutcome, *, details: bool
) -> Iterator[tuple[str, object]]:
    """Yield whether the guarantee is claimed, and with `details` the facts under this verdict."""
    found = guarantee_of(outcome, assumptions_of(outcome), description.get("verified"))
    if found is None:
        return
    yield "guarantee", f"{found.what}: {found.why}"
    for label, value, known in facts_of(outcome, description.get("verified")) if details else ():
        yield label, f"{value} ({known})" if known else value


def _verdict(outcome: RunOutcome, *, details: bool) -> Iterator[tuple[str, object]]:
    """Yield the figures of the run, and which assumptions of the guarantee were met."""
    metrics = outcome.metrics
    if details:
        yield from _figures(metrics)
    why = outcome.departures
    for name, met in outcome.assumptions.items():
        if met and not details:
            continue
        place = f": {departures_text(why[name])}" if name in why else ""
        yield f"assumption: {name.replace('_', ' ')}", "met" if met else f"NOT MET{place}"
    outages = metrics.get("outages")
    if isinstance(outages, Mapping):
        for label, value, how in outage_rows(outages):
            yield label, f"{value} ({how})"
        _, words, numbers = outage_verdict(outages)
        yield "outages", f"{words}: {numbers}"


def _figures(metrics: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    """Yield the figures of the run, and the ages of its measurements."""
    for key, (label, unit) in _FIGURES.items():
        value = metrics.get(key)
        if isinstance(value, float | int) and math.isfinite(value):
            yield label, f"{value:.5g}{unit}"
    age = metrics.get("feedback_age")
    for line in age_lines(age) if isinstance(age, Mapping) else ():
        label, _, words = line.partition(": ")
        yield label, words
    each = metrics.get("measurement_ages")
    for name, words in measurement_age_lines(each).items() if isinstance(each, Mapping) else ():
        yield f"age of {name}", words


def _topics(topics: list[dict[str, Any]]) -> RichTable:
    table = RichTable(box=None, padding=(0, 2, 0, 0))
    table.add_column("topic")
    table.add_column("messages", justify="right")
    table.add_column("rate [1/s]", justify="right")
    table.add_column("signals", overflow="fold")
    for topic in topics:
        rate = "" if topic["rate_hz"] is None else f"{topic['rate_hz']:.4g}"
        names = [f"{s['name']} [{s['unit']}]" if s["unit"] else s["name"] for s in topic["signals"]]
        signals = ", ".join(names[:4]) + (f", ... ({len(names)})" if len(names) > 4 else "")
        table.add_row(
            _text(topic["topic"]), str(topic["count"]), rate, _text(signals or topic["schema"])
        )
    return table


def _links(links: Mapping[str, Mapping[str, str]]) -> RichTable:
    present = {
        figure
        for link in links.values()
        for figure, value in link.items()
        if figure not in _WHERE_ANY or value != "0"
    }
    figures = [figure for figure in _LINK_FIGURES if figure in present] or sorted(present)
    table = RichTable(box=None, padding=(0, 2, 0, 0))
    table.add_column("link")
    for figure in figures:
        table.add_column(_text(figure), justify="right")
    for name, link in links.items():
        table.add_row(_text(name), *(_text(_short(link.get(figure, ""))) for figure in figures))
    return table


def _short(figure: str) -> str:
    try:
        return f"{float(figure):.6g}"
    except ValueError:
        return figure
