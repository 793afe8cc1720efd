"""Studies, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim.cli.terminal import NONE, facts_table, number
from cosim.study import (
    Boundary,
    Group as RunGroup,
    MergedStudy,
    Numbers,
    Quantile,
    RareEstimate,
    Sensitivity,
    Share,
    Stopping,
    StudyReport,
    StudyResult,
    Summary,
)


def checked_view(data: dict[str, Any]) -> RenderableType:
    """Show what a study would run: axes, metrics, number of runs."""
    table = Table(box=None, pad_edge=False)
    for column in ("axis", "changes", "first run", "last run"):
        table.add_column(column)
    for axis, places in data["axes"].items():
        ends = (str(data[end][axis])[:24] for end in ("first", "last"))
        table.add_row(axis, "\n".join(places), *ends)
    about = "" if data["runs_are"] == "exactly" else f"{data['runs_are']} "
    head = Text.assemble(
        (data["title"], "bold"), f"\n{about}{data['runs']} runs of the scenario {data['scenario']}"
    )
    return Group(head, table, Text(f"metrics: {', '.join(data['metrics'])}"))


_MOST_REASONS = 5


def finished_view(name: str, done: StudyResult) -> RenderableType:
    """Show the number of runs per status, what ended runs early, and where the table is.

    `name` : of the study on the command line.
    """
    facts = facts_table()
    now = f"{done.executed} of them executed now, in {done.seconds:.3g} s"
    of = "" if done.runs == done.count else f" of {done.count}"
    facts.add_row("runs", f"{done.runs}{of}", now)
    for status, count in sorted(done.statuses.items()):
        label = Text(status.replace("_", " "), style="" if status == "finished" else "yellow")
        facts.add_row(label, str(count), "")
    if done.retried:
        facts.add_row("tried again", str(done.retried), "runs, since their worker died")
    parts: list[RenderableType] = [facts]
    for row in done.incomplete[:_MOST_REASONS]:
        reason = (row.reason or "").splitlines() or [""]
        parts.append(Text(f"run {row.run} {row.status.replace('_', ' ')}: {reason[0]}", "yellow"))
    if done.incomplete:
        more = len(done.incomplete) - _MOST_REASONS
        alone = f"cosim study repeat {name} {done.incomplete[0].run}"
        parts.append(Text(f"{f'and {more} more; ' if more > 0 else ''}one alone: {alone}"))
    if done.traces:
        kept = [run for run, why in done.traces.items() if why is None]
        parts.append(Text(f"traces: {len(kept)} in {done.folder / 'traces'}"))
        for run, why in done.traces.items():
            if why is not None:
                parts.append(Text(f"no trace of run {run}: {why}", style="yellow"))
    table = str(done.results) if done.runs == done.count else "written when all runs are done"
    parts.append(Text(f"table:  {table}\nnext:   cosim study show {done.folder}"))
    return Group(*parts)


def merged_view(found: MergedStudy) -> RenderableType:
    """Show how many runs are there, which are missing, and where the table is."""
    facts = facts_table()
    of = "" if found.runs == found.count else f" of {found.count}"
    facts.add_row("runs", f"{found.runs}{of}", f"{found.twice} of them in several folders")
    facts.add_row("traces copied", str(found.traces), "")
    parts: list[RenderableType] = [facts]
    if found.without_trace:
        runs = ", ".join(map(str, found.without_trace[:_MOST_REASONS]))
        parts.append(Text(f"no trace of run {runs}: the study's own command adds it", "yellow"))
    if found.missing:
        parts.append(Text(f"missing: --runs {', --runs '.join(found.missing)}", "yellow"))
    table = str(found.results) if found.runs == found.count else "written when all runs are there"
    parts.append(Text(f"table:  {table}\nnext:   cosim study show {found.folder}"))
    return Group(*parts)


def summary_view(found: Summary, edge: Boundary | None, picture: Path | None) -> RenderableType:
    """Show shares and means per group, and the stability boundary."""
    of = "" if found.runs == found.count else f" of {found.count}: the study is not finished"
    head = Text.assemble(
        (found.title, "bold"),
        f"\n{found.runs} runs{of}; intervals: {100 * found.confidence:g} %, "
        f"shares Wilson, means {found.method}",
    )
    parts: list[RenderableType] = [head]
    parts += [_all_runs(found.groups[0])] if not found.by else [_per_group(found)]
    if edge is not None:
        parts.append(_boundary(edge))
    if picture is not None:
        parts.append(Text(f"picture: {picture}"))
    return Group(*parts)


def sensitivity_view(found: Sensitivity) -> RenderableType:
    """Show the indices of each axis."""
    table = Table(box=None, pad_edge=False)
    for column in ("axis", "alone", "interval", "with others", "interval"):
        table.add_column(column, justify="left" if column == "axis" else "right")
    for axis, first in found.first.items():
        cells = []
        for index in (first, found.total[axis]):
            cells += [f"{index.value:.3f}", f"[{index.low:.3f}, {index.high:.3f}]"]
        table.add_row(axis, *cells)
    head = Text(
        f"shares of the variance of {found.metric}, {found.samples} samples; "
        f"intervals: {100 * found.confidence:g} %, bootstrap"
    )
    return Group(head, table)


def study_report_view(written: StudyReport) -> RenderableType:
    """Show where the page is, and what is on it."""
    facts = facts_table()
    of = "" if written.complete else "the study is not finished"
    facts.add_row("runs", str(written.runs), of)
    for status, count in written.statuses.items():
        label = Text(status.replace("_", " "), style="" if status == "finished" else "yellow")
        facts.add_row(label, str(count), "")
    parts: list[RenderableType] = [Text(written.title, style="bold"), facts]
    if written.unread:
        parts.append(Text(f"{written.unread} lines of the run log cannot be read", style="yellow"))
    size = f"{written.bytes / 1e6:.2g} MB, {written.metrics} metrics, {written.charts} charts"
    parts.append(Text(f"page: {written.output} ({size})"))
    return Group(*parts)


def stopped_view(found: Stopping) -> RenderableType:
    """Show what a study that stops at a width has reached, and after how many runs."""
    word = "as narrow as asked for" if found.reached else "wider than asked for"
    missing = f", {found.missing} without a value" if found.missing else ""
    what = (
        f"{found.metric}: {found.value:.4g} [{found.low:.4g}, {found.high:.4g}], "
        f"{found.high - found.low:.3g} wide: {word}, {found.width:g}"
    )
    how = (
        f"{'stopped after' if found.reached else 'after'} {found.runs} of at most {found.most} "
        f"runs{missing}; look {len(found.looks)}, at {100 * found.look_confidence:.4g} % each, so "
        f"that all looks together have {100 * found.confidence:g} %"
    )
    return Text(f"{what}\n{how}", style="" if found.reached else "yellow")


def rare_view(
    event: Mapping[str, Any], found: RareEstimate | None, runs: int, confidence: float
) -> RenderableType:
    """Show the probability of a rare event, and the levels on the way to it."""
    over = event.get("above") is not None
    bound = event["above"] if over else event["below"]
    name = f"P({event['metric']} {'>' if over else '<'} {bound:g})"
    if found is None:
        return Text(f"the summary is of the first level\n{name}: not finished, {runs} runs")
    table = Table(box=None, pad_edge=False)
    for column in ("level", "bound", "share beyond", "moves accepted", "correlation", "deviation"):
        table.add_column(column, justify="right")
    for place, level in enumerate(found.levels, 1):
        at = bound + level.beyond if over else bound - level.beyond
        table.add_row(
            str(place),
            f"{at:.5g}",
            f"{100 * level.share:.1f} %",
            NONE if level.acceptance is None else f"{100 * level.acceptance:.0f} %",
            f"{level.correlation:.2f}",
            f"{level.deviation:.3f}",
        )
    if found.probability is None or found.deviation is None:
        answer = Text(f"{name}: no estimate; {found.reason}", style="yellow")
    else:
        low, high = found.interval(confidence)
        answer = Text(
            f"{name} = {found.probability:.3g} [{low:.3g}, {high:.3g}], coefficient of variation "
            f"{found.deviation:.2g}",
            style="bold",
        )
    method = event.get("method", "subset")
    if method == "importance":
        effective = "" if found.effective is None else f", {found.effective:.4g} effective"
        how = f"importance sampling{effective}; levels of the pilot above"
    else:
        how = "subset simulation; deviations include the correlation along chains"
    searches = [f"{p:.3g}" for p in found.populations]
    if found.exploration is not None:
        searches.append(f"{found.exploration:.3g} from far out")
    if found.regions is not None:
        searches.append("one region" if found.regions == 1 else f"{found.regions} regions")
    return Group(
        Text("the summary is of the first level, which has the distributions of the axes"),
        table,
        answer,
        *([Text(f"independent searches found {', '.join(searches)}")] if searches else []),
        Text(f"{how}; {runs} runs"),
    )


def _all_runs(group: RunGroup) -> RenderableType:
    table = Table(box=None, pad_edge=False)
    table.add_column("metric")
    for column in ("mean or share", "interval", "deviation", "min", "median", "max", "runs"):
        table.add_column(column, justify="right")
    for name, share in group.shares.items():
        table.add_row(name, *_share(share), "", "", "", "", f"{share.count} of {share.of}")
    for name, found in group.numbers.items():
        table.add_row(
            name,
            *_mean(found),
            *(number(v, 4) for v in (found.deviation, found.minimum, found.median, found.maximum)),
            str(found.count) + (f", {found.missing} without" if found.missing else ""),
        )
        for one in found.quantiles:
            table.add_row(f"  {100 * one.share:g} % below", *_quantile(one), *[""] * 5)
    return table


def _per_group(found: Summary) -> RenderableType:
    shares = list(dict.fromkeys(n for g in found.groups for n in g.shares))
    means = list(dict.fromkeys(n for g in found.groups for n in g.numbers))
    table = Table(box=None, pad_edge=False)
    for axis in found.by:
        table.add_column(axis, style="bold", justify="right")
    table.add_column("runs", justify="right")
    for name in (*shares, *means):
        table.add_column(name, justify="right")
    for group in found.groups:
        cells = [_value(group.where[axis]) for axis in found.by]
        for name in shares:
            share = group.shares.get(name)
            cells.append(NONE if share is None else " ".join(_share(share)))
        for name in means:
            mean = group.numbers.get(name)
            parts = [] if mean is None else [_mean(mean), *map(_quantile, mean.quantiles)]
            cells.append("\n".join(" ".join(part) for part in parts) or NONE)
        table.add_row(*cells[: len(found.by)], str(group.runs), *cells[len(found.by) :])
    return table


def _share(found: Share) -> tuple[str, str]:
    return f"{100 * found.share:.1f} %", f"[{100 * found.low:.1f}, {100 * found.high:.1f}]"


def _mean(found: Numbers) -> tuple[str, str]:
    if found.low is None or found.high is None or found.low == found.high:
        return number(found.mean, 4), ""
    return number(found.mean, 4), f"[{found.low:.4g}, {found.high:.4g}]"


def _quantile(found: Quantile) -> tuple[str, str]:
    low, high = (NONE if end is None else f"{end:.4g}" for end in (found.low, found.high))
    return number(found.value, 4), f"[{low}, {high}]"


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _boundary(edge: Boundary) -> RenderableType:
    table = Table(
        box=None, pad_edge=False, title="Loss of stability as the delay grows", title_justify="left"
    )
    for column in ("loss", "stable up to", "not stable from", "certified up to"):
        table.add_column(column, justify="right")
    for each in edge.edges:
        table.add_row(
            number(each.loss, 3),
            *(number(v, 5, "s") for v in (each.stable_to, each.unstable_from, each.certified_to)),
        )
    facts = facts_table()
    facts.add_row("exact delay margin", number(edge.exact_margin, 6, "s"), "computed, without loss")
    facts.add_row(
        "age that the design allows", number(edge.certified_age, 5, "s"), "certified up to this"
    )
    for label, holds in (
        ("exact margin inside the measured boundary", edge.agrees),
        ("all certified delays measured stable", edge.certified_inside),
    ):
        if holds is not None:
            word = Text("yes", style="green") if holds else Text("no", style="red")
            facts.add_row(label, word, "measured")
    return Group(table, facts)
