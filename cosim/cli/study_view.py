"""Studies, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.terminal import NONE, facts, number, table, typed
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
    rows = (
        (axis, "\n".join(places), *(str(data[end][axis]) for end in ("first", "last")))
        for axis, places in data["axes"].items()
    )
    head = Text(data["title"], "bold")
    axes = table("axis|changes|first run|last run", rows)
    return Group(head, axes, Text(f"metrics: {', '.join(data['metrics'])}"))


def checked_line(data: dict[str, Any]) -> str:
    """Say how many runs a study has, and of what."""
    about = "" if data["runs_are"] == "exactly" else f"{data['runs_are']} "
    return f"{data['study']}: ok, {about}{data['runs']} runs of the scenario {data['scenario']}"


_MOST_REASONS = 5


def finished_line(name: str, done: StudyResult) -> str:
    """Say how many runs of a study are done, how they ended, and where the table is."""
    statuses = ", ".join(f"{n} {s.replace('_', ' ')}" for s, n in sorted(done.statuses.items()))
    where = f"table: {done.results}" if done.runs == done.count else "the table waits for the rest"
    return f"{name}: {done.runs} of {done.count} runs done ({statuses}); {where}"


def show_commands(folder: Path) -> tuple[str, str]:
    """Return the commands that show a study."""
    return typed("study show", folder), typed("study report", folder)


def finished_view(name: str, done: StudyResult) -> RenderableType:
    """Show the number of runs per status, what ended runs early, and where the table is.

    `name` : of the study on the command line.
    """
    now = f"{done.executed} of them executed now, in {done.seconds:.3g} s"
    of = "" if done.runs == done.count else f" of {done.count}"
    retried = ("tried again", str(done.retried), "runs, since their worker died")
    statuses = _statuses(dict(sorted(done.statuses.items())))
    runs = facts(("runs", f"{done.runs}{of}", now), *statuses, *[retried] * bool(done.retried))
    parts: list[RenderableType] = [runs]
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
    return Group(*parts)


def _statuses(counts: Mapping[str, int]) -> Iterator[tuple[Text, str]]:
    """Yield a row for the runs of each status."""
    for status, count in counts.items():
        style = "" if status == "finished" else "yellow"
        yield Text(status.replace("_", " "), style), str(count)


def merged_line(found: MergedStudy) -> str:
    """Say how many runs are in one folder now, and where the table is."""
    where = f"table: {found.results}" if found.runs == found.count else "the table waits for them"
    missing = "" if found.runs == found.count else f", {found.count - found.runs} missing"
    return f"merged: {found.runs} of {found.count} runs{missing}; {where}"


def merged_view(found: MergedStudy) -> RenderableType:
    """Show how many runs are there, which are missing, and where the table is."""
    of = "" if found.runs == found.count else f" of {found.count}"
    runs = facts(
        ("runs", f"{found.runs}{of}", f"{found.twice} of them in several folders"),
        ("traces copied", str(found.traces)),
    )
    parts: list[RenderableType] = [runs]
    if found.without_trace:
        some = ", ".join(map(str, found.without_trace[:_MOST_REASONS]))
        parts.append(Text(f"no trace of run {some}: the study's own command adds it", "yellow"))
    if found.missing:
        parts.append(Text(f"missing: --runs {', --runs '.join(found.missing)}", "yellow"))
    return Group(*parts)


def summary_line(found: Summary) -> str:
    """Say of what study the summary is, and of how many runs."""
    of = "" if found.runs == found.count else f" of {found.count}: the study is not finished"
    return f"{found.title}: {found.runs} runs{of}"


def summary_view(found: Summary, edge: Boundary | None, picture: Path | None) -> RenderableType:
    """Show shares and means per group, and the stability boundary."""
    head = Text(
        f"intervals: {100 * found.confidence:g} %, shares Wilson, means {found.method}", "dim"
    )
    parts: list[RenderableType] = [head]
    parts += [_all_runs(found.groups[0])] if not found.by else [_per_group(found)]
    if edge is not None:
        parts.append(_boundary(edge))
    if picture is not None:
        parts.append(Text(f"picture: {picture}"))
    return Group(*parts)


def sensitivity_line(found: Sensitivity) -> str:
    """Say which axis the variance of a metric is due to the most."""
    axis = max(found.total, key=lambda each: found.total[each].value)
    share = found.total[axis].value
    return f"{found.metric}: most of its variance comes with {axis} ({share:.2f}, with others)"


def sensitivity_view(found: Sensitivity) -> RenderableType:
    """Show the indices of each axis."""
    rows = (
        (axis, *_index(first), *_index(found.total[axis])) for axis, first in found.first.items()
    )
    head = Text(
        f"shares of the variance of {found.metric}, {found.samples} samples; "
        f"intervals: {100 * found.confidence:g} %, bootstrap"
    )
    return Group(head, table("axis|>alone|>interval|>with others|>interval", rows))


def _index(index: Any) -> tuple[str, str]:
    return f"{index.value:.3f}", f"[{index.low:.3f}, {index.high:.3f}]"


def study_report_view(written: StudyReport) -> RenderableType:
    """Show where the page is, and what is on it."""
    of = "" if written.complete else "the study is not finished"
    runs = facts(("runs", str(written.runs), of), *_statuses(written.statuses))
    parts: list[RenderableType] = [Text(written.title), runs]
    if written.unread:
        parts.append(Text(f"{written.unread} lines of the run log cannot be read", style="yellow"))
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
    rows = (
        (
            str(place),
            f"{bound + level.beyond if over else bound - level.beyond:.5g}",
            f"{100 * level.share:.1f} %",
            NONE if level.acceptance is None else f"{100 * level.acceptance:.0f} %",
            f"{level.correlation:.2f}",
            f"{level.deviation:.3f}",
        )
        for place, level in enumerate(found.levels, 1)
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
        table(">level|>bound|>share beyond|>moves accepted|>correlation|>deviation", rows),
        answer,
        *([Text(f"independent searches found {', '.join(searches)}")] if searches else []),
        Text(f"{how}; {runs} runs"),
    )


def _all_runs(group: RunGroup) -> RenderableType:
    rows: list[tuple[str, ...]] = [
        (name, *_share(share), *[""] * 4, f"{share.count} of {share.of}")
        for name, share in group.shares.items()
    ]
    for name, found in group.numbers.items():
        spread = (found.deviation, found.minimum, found.median, found.maximum)
        without = f", {found.missing} without" if found.missing else ""
        values = (number(v, 4) for v in spread)
        rows.append((name, *_mean(found), *values, f"{found.count}{without}"))
        rows += ((f"  {100 * one.share:g} % below", *_quantile(one)) for one in found.quantiles)
    columns = "metric|>mean or share|>interval|>deviation|>min|>median|>max|>runs"
    return table(columns, rows)


def _per_group(found: Summary) -> RenderableType:
    shares = list(dict.fromkeys(n for g in found.groups for n in g.shares))
    means = list(dict.fromkeys(n for g in found.groups for n in g.numbers))

    def row(group: RunGroup) -> Iterator[str]:
        yield from (_value(group.where[axis]) for axis in found.by)
        yield str(group.runs)
        for share in map(group.shares.get, shares):
            yield NONE if share is None else " ".join(_share(share))
        for mean in map(group.numbers.get, means):
            parts = [] if mean is None else [_mean(mean), *map(_quantile, mean.quantiles)]
            yield "\n".join(map(" ".join, parts)) or NONE

    columns = (*(f">*{axis}" for axis in found.by), *(f">{n}" for n in ("runs", *shares, *means)))
    return table(columns, map(row, found.groups))


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
    rows = (
        (
            number(each.loss, 3),
            *(number(v, 5, "s") for v in (each.stable_to, each.unstable_from, each.certified_to)),
        )
        for each in edge.edges
    )
    answers = (
        ("exact margin inside the measured boundary", edge.agrees),
        ("all certified delays measured stable", edge.certified_inside),
    )
    return Group(
        table(
            ">loss|>stable up to|>not stable from|>certified up to",
            rows,
            "Loss of stability as the delay grows",
        ),
        facts(
            ("exact delay margin", number(edge.exact_margin, 6, "s"), "computed, without loss"),
            (
                "age that the design allows",
                number(edge.certified_age, 5, "s"),
                "certified up to this",
            ),
            *(
                (label, Text("yes", "green") if holds else Text("no", "red"), "measured")
                for label, holds in answers
                if holds is not None
            ),
        ),
    )
