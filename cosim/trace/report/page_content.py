"""Collect the content of a report from a trace, for the HTML page and for Rerun."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.page import LARGEST
from cosim.trace.info import description_of
from cosim.trace.outcome import duration_words, key_figures, verdict
from cosim.trace.outcome.run_figures import ABSENT
from cosim.trace.outcome.run_outcome import RunOutcome, outcome_of
from cosim.trace.reader import Trace
from cosim.trace.report import generic, link_spans, traffic_rows, vehicle
from cosim.trace.report.chart import Chart
from cosim.trace.report.parameters import ChangedParameter, Settings
from cosim.trace.report.series import DrawnSeries, Recording
from cosim.trace.report.timeline import LogLine, TimelineEntry, log_of, timeline_of
from cosim.trace.rows.layout import HOST_PREFIX

MAX_ROWS = 400
"""Most rows of the table of signals."""


@dataclass(frozen=True)
class Row:
    """The figures of a signal; None where it has no number. `gaps` counts missing numbers."""

    topic: str
    name: str
    unit: str
    count: int
    first: float | None
    least: float | None
    most: float | None
    last: float | None
    gaps: int


@dataclass(frozen=True)
class Section:
    """Charts under a heading; `folded` in views that can fold them."""

    key: str
    title: str
    charts: list[Chart]
    folded: bool = False

    @property
    def rank(self) -> int:
        """Place on the page: the links first, which are not folded."""
        return 0 if self.key == "age" else 1


@dataclass(frozen=True)
class Content:
    """The content of a report.

    Attributes
    ----------
    info : as from `cosim.trace.describe`.
    outcome : of the run; one that says nothing where it left none.
    series : every signal of numbers.
    span : first and last time shown [s].
    log : its lines, of all levels.
    messages : of each link when it delivered and dropped, for the animation.
    spans : where links deliver nothing.
    left_out : what is not drawn, and why.
    """

    info: dict[str, Any]
    outcome: RunOutcome
    name: str
    status: verdict.Statement
    guarantee: verdict.Statement | None
    assumptions: list[verdict.Statement]
    assertions: list[verdict.Statement]
    figures: list[tuple[str, str, str]]
    bars: list[tuple[str, float, float, str]]
    timeline: list[TimelineEntry]
    log: list[LogLine]
    links: list[traffic_rows.LinkFigures]
    spans: list[link_spans.LinkSpan]
    messages: list[dict[str, Any]]
    path: dict[str, Any] | None
    sections: list[Section]
    changes: list[ChangedParameter]
    components: list[dict[str, str]]
    provenance: list[tuple[str, str]]
    rows: list[Row]
    series: list[DrawnSeries]
    span: tuple[float, float]
    origin_ns: int
    left_out: list[tuple[str, str]]

    @property
    def answer(self) -> str:
        """How the run ended, against what was asked: the first line of every view of it."""
        return verdict.ended_of(self.info).what

    @property
    def explained(self) -> str:
        """What the answer does not say of why the run ended so."""
        first, _, rest = self.status.why.partition("\n")
        return rest if first.rstrip() in self.answer else self.status.why

    @property
    def duration(self) -> str:
        """How long the run was; "" where that is unknown."""
        run = self.outcome
        if run.simulated_s is None:
            return ""
        wall = (self.info["result"] or {}).get(f"{HOST_PREFIX}wall_s")
        return duration_words(run.simulated_s, _seconds(wall), run.steps)

    @property
    def key_figures(self) -> list[tuple[str, str, str]]:
        """The figures that the run has, beside those that are drawn as bars."""
        drawn = {"gamma", "exact norm, nominal loop", "gain of the zero-state run"}
        figures = key_figures(self.outcome.metrics)
        return [row for row in figures if row[1] != ABSENT and row[0] not in drawn]

    @property
    def shaded(self) -> list[str]:
        """What is shaded in the charts over time, in words."""
        return link_spans.spans_words(self.spans)

    @property
    def lead(self) -> Chart | None:
        """The chart beside the verdict where there is no path: the first one of signals."""
        if self.path is not None:
            return None
        return next((s.charts[0] for s in self.sections if s.key == "signals"), None)

    @property
    def charts(self) -> list[Chart]:
        """The charts of all sections."""
        return [chart for section in self.sections for chart in section.charts]


def content_of(path: Path) -> Content:
    """Read a trace, finished or not, or any MCAP file; `InputError` if it is none."""
    trace = Trace(path, incomplete=True)
    info = description_of(trace, hashed=True)
    settings = Settings(trace)
    recording = Recording(trace)
    found = outcome_of(trace.result)
    outcome = found or RunOutcome(version=0)
    metrics = outcome.metrics
    links = traffic_rows.figures(recording, outcome.links)
    log = log_of(recording)
    assumptions = verdict.assumptions_of(outcome)
    span = _span(recording)
    spans = link_spans.spans_of(recording, log, span)
    craft = vehicle.vehicle_of(recording)
    sections = list(_sections(recording, settings, metrics, craft))
    return Content(
        info=info,
        outcome=outcome,
        name=path.name,
        status=verdict.status_of(info, found),
        guarantee=verdict.guarantee_of(outcome, assumptions, info["verified"]),
        assumptions=assumptions,
        assertions=verdict.assertions_of(outcome),
        figures=[
            *verdict.facts_of(outcome, info["verified"]),
            *verdict.figures_of(metrics),
        ],
        bars=_bars(metrics),
        timeline=timeline_of(recording, outcome, log),
        log=log,
        links=links,
        spans=spans,
        messages=link_spans.link_figures(recording, spans),
        path=None if craft is None else vehicle.path_of(craft) or None,
        sections=sections,
        changes=list(settings.changes()),
        components=_components(info["run"]),
        provenance=list(_provenance(info)),
        rows=[_row(series) for series in recording.series[:MAX_ROWS]],
        series=recording.series,
        span=span,
        origin_ns=recording.origin_ns,
        left_out=list(_left_out(recording, sections)),
    )


def _sections(
    recording: Recording,
    settings: Settings,
    metrics: Mapping[str, Any],
    craft: vehicle.Vehicle | None,
) -> Iterator[Section]:
    charted: set[str] = set()
    if craft is not None:
        charted = vehicle.drawn(craft)
        yield Section("vehicle", "The vehicle", list(vehicle.charts_of(craft, recording, settings)))
    age = traffic_rows.chart_of(recording, metrics)
    if age is not None and age.curves:
        yield Section("age", "The links", [age])
    rest = list(generic.charts_of(recording, charted))
    if rest:
        title = "All other signals" if craft is not None else "Signals"
        yield Section("signals", title, rest, folded=craft is not None)


def _left_out(recording: Recording, sections: list[Section]) -> Iterator[tuple[str, str]]:
    yield from recording.unread.items()
    wild = [s.full_name for s in recording.series if np.any(np.abs(s.values) > LARGEST)]
    if wild:
        yield f"values beyond {LARGEST:g}", f"drawn there: {', '.join(wild[:8])}"
    drawn = next((len(s.charts) for s in sections if s.key == "signals"), 0)
    if drawn == generic.MAX_CHARTS:
        yield "further signals", f"a report has at most {generic.MAX_CHARTS} such charts"
    if len(recording.series) > MAX_ROWS:
        more = len(recording.series) - MAX_ROWS
        yield f"{more} signals", f"not in the table, which has {MAX_ROWS} rows"


def _bars(metrics: Mapping[str, Any]) -> list[tuple[str, float, float, str]]:
    """Return label, value, share of the greatest, and origin of gain, norm and bound."""
    found = [
        (label, float(metrics[key]), how)
        for key, label, how in (
            ("gain", "gain of this run", "measured"),
            ("exact_norm", "exact norm", "computed"),
            ("gamma", "bound γ", "certified"),
        )
        if isinstance(metrics.get(key), int | float)
    ]
    most = max((value for _, value, _ in found), default=0.0)
    return [(label, v, v / most if most > 0 else 0.0, how) for label, v, how in found]


def _components(run: Mapping[str, str]) -> list[dict[str, str]]:
    names = [k.removeprefix("fmu.").removesuffix(".sha256") for k in run if k.startswith("fmu.")]
    return [
        {"name": n, "fmu": run.get(f"fmu.{n}", ""), "sha256": run.get(f"fmu.{n}.sha256", "")}
        for n in sorted(set(names))
    ]


def _provenance(info: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "trace", f"{Path(info['path']).name}, {info['bytes']:,} bytes"
    yield "content hash", str(info["content_hash"])
    yield "messages", f"{info['message_count']:,} on {len(info['topics'])} topics"
    yield "written by", str(info["library"] or "unknown")
    run, result = info["run"], info["result"] or {}
    for key in sorted(run, key=lambda key: (key.startswith(HOST_PREFIX), key)):
        if not key.startswith(("fmu.", "title", "certificate.")):
            yield key.removeprefix(HOST_PREFIX), str(run[key])
    for key in sorted(result):
        if key.startswith(HOST_PREFIX) or key in {"steps", "simulated_s"}:
            yield key.removeprefix(HOST_PREFIX), str(result[key])
    for item in info["attachments"]:
        yield "attached", f"{item['name']} ({item['media_type']}, {item['bytes']:,} bytes)"


def _row(series: DrawnSeries) -> Row:
    values = series.values
    finite = values[np.isfinite(values)]
    first, last = (float(v) if np.isfinite(v) else None for v in values[[0, -1]])
    least, most = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
    unit, count, gaps = series.unit or "", series.count, series.gaps
    return Row(series.topic, series.name, unit, count, first, least, most, last, gaps)


def _seconds(text: str | None) -> float | None:
    """Return a number of seconds; None where there is none, as other programs may write it."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _span(recording: Recording) -> tuple[float, float]:
    ends = [float(s.t[i]) for s in recording.series for i in (0, -1)]
    return min(ends, default=0.0), max(ends, default=0.0)
