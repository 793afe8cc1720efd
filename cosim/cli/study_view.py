"""Studies, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.terminal import NONE, console, facts, number, table, typed
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


def unfinished(found: Summary) -> str:
    """Say how many runs of a study are done, if not all are."""
    done = found.runs == found.count
    return "" if done else f" ({found.runs} of {found.count} runs: the study is not finished)"


def summary_view(
    found: Summary,
    edge: Boundary | None,
    *,
    answers: Sequence[str],
    pooling: str,
    details: bool = False,
) -> RenderableType:
    """Show shares and means per group, and the stability boundary.

    answers, pooling : as from `answers_of` and `pooling_words`.
    details : every metric of every group with its intervals, however wide that is.
    """
    methods = f"{100 * found.confidence:g} %, shares Wilson, means {found.method}"
    intervals = "" if _without(found) else f" Intervals: {methods}."
    parts: list[RenderableType] = [Text(f"{found.runs} runs. {pooling}{intervals}", "dim")]
    if not found.by:
        parts.append(_all_runs(found.groups[0], details=details))
    else:
        parts += [_per_group(found)] if details else _narrow(found, answers)
    if edge is not None:
        parts.append(_boundary(edge))
    return Group(*parts)


def sensitivity_line(found: Sensitivity) -> str:
    """Say which axis the variance of a metric is due to the most."""
    axis = max(found.total, key=lambda each: found.total[each].value)
    share = found.total[axis].value
    return f"{found.metric}: most of its variance comes with {axis} ({share:.2f}, with others)"


def _without(found: Summary) -> bool:
    """Whether nothing in a summary has an interval."""
    for group in found.groups:
        kinds = list(group.shares.values()), list(group.numbers.values())
        ends = [(one.low, one.high) for kind in kinds for one in kind]
        if any(low is not None and low != high for low, high in ends):
            return False
    return True


_VALUE = "mean or share"
_MOST_LINES = 40
_GAP = 2
"""Spaces between the columns of a table."""


def _narrow(found: Summary, answers: Sequence[str]) -> list[RenderableType]:
    """Return a table of as many metrics as fit on the terminal: those of the answers first."""
    asked = [line.partition(": ")[0] for line in answers]
    names = list(dict.fromkeys(n for g in found.groups for n in (*g.shares, *g.numbers)))
    plain_end = "status = finished"
    chosen = [*(n for n in asked if n in names), *(n for n in names if n not in asked)]
    chosen = [name for name in chosen if name != plain_end]
    columns = {
        **{axis: [_value(g.where[axis]) for g in found.groups] for axis in found.by},
        "runs": [str(g.runs) for g in found.groups],
    }
    left_out, room = [], console().width + _GAP - sum(map(_width, columns.items()))
    for name in chosen:
        column = name, [_short(group, name) for group in found.groups]
        if (width := _width(column)) <= room:
            columns[name] = column[1]
            room -= width
        else:
            left_out.append(name)
    headings = (f">{'*' if name in found.by else ''}{name}" for name in columns)
    rows = list(zip(*columns.values(), strict=True))
    parts: list[RenderableType] = [table(headings, rows[:_MOST_LINES])]
    more = [f"{len(rows) - _MOST_LINES} more rows"] if len(rows) > _MOST_LINES else []
    if more or left_out:
        words = ", ".join([*more, *left_out])
        parts.append(Text(f"not shown: {words} (--details, --json)", style="dim"))
    return parts


def _width(column: tuple[str, Sequence[str]]) -> int:
    """Return how wide a column of a table is, with the space after it."""
    return max(map(len, (column[0], *column[1]))) + _GAP


def _short(group: RunGroup, name: str) -> str:
    """Return a share as numbers of runs, or a mean."""
    if name in group.shares:
        found = group.shares[name]
        if found.of == 1:
            return "yes" if found.count else "no"
        return f"{found.count} of {found.of}"
    mean = group.numbers.get(name)
    return NONE if mean is None else number(mean.mean, 4)


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


def stopped_line(found: Stopping) -> str:
    """Say what a study that stops at a width has reached."""
    word = "as narrow as asked for" if found.reached else "wider than asked for"
    return (
        f"{found.metric}: {found.value:.4g} [{found.low:.4g}, {found.high:.4g}], "
        f"{found.high - found.low:.3g} wide: {word}, {found.width:g}"
    )


def stopped_view(found: Stopping) -> RenderableType:
    """Show after how many runs a study stopped, or that it did not."""
    missing = f", {found.missing} without a value" if found.missing else ""
    how = (
        f"{'stopped after' if found.reached else 'after'} {found.runs} of at most {found.most} "
        f"runs{missing}; look {len(found.looks)}, at {100 * found.look_confidence:.4g} % each, so "
        f"that all looks together have {100 * found.confidence:g} %"
    )
    return Text(how, style="" if found.reached else "yellow")


def rare_line(event: Mapping[str, Any], found: RareEstimate | None, confidence: float) -> str:
    """Say how probable a rare event is."""
    name = _event(event)
    if found is None:
        return f"{name}: not finished"
    if found.probability is None or found.deviation is None:
        return f"{name}: no estimate; {found.reason}"
    low, high = found.interval(confidence)
    return (
        f"{name} = {found.probability:.3g} [{low:.3g}, {high:.3g}], coefficient of variation "
        f"{found.deviation:.2g}"
    )


def _event(event: Mapping[str, Any]) -> str:
    over = event.get("above") is not None
    bound = event["above"] if over else event["below"]
    return f"P({event['metric']} {'>' if over else '<'} {bound:g})"


def rare_view(event: Mapping[str, Any], found: RareEstimate | None, runs: int) -> RenderableType:
    """Show the levels on the way to a rare event."""
    over = event.get("above") is not None
    bound = event["above"] if over else event["below"]
    if found is None:
        return Text(f"the summary is of the first level, {runs} runs so far")
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
        *([Text(f"independent searches found {', '.join(searches)}")] if searches else []),
        Text(f"{how}; {runs} runs"),
    )


def _all_runs(group: RunGroup, *, details: bool) -> RenderableType:
    """Return a table of the metrics of all runs; `details` : with spread and quantiles."""
    rows: list[dict[str, str]] = []
    for name, share in group.shares.items():
        value, interval = _share(share)
        count = f"{share.count} of {share.of}"
        rows.append({"metric": name, _VALUE: value, "interval": interval, "runs": count})
    for name, found in group.numbers.items():
        value, interval = _mean(found)
        ends = {"min": number(found.minimum, 4), "max": number(found.maximum, 4)}
        spread = {"deviation": number(found.deviation, 4), "median": number(found.median, 4)}
        without = f", {found.missing} without" if found.missing else ""
        runs = f"{found.count}{without}"
        rows.append(
            {"metric": name, _VALUE: value, "interval": interval, "runs": runs, **ends, **spread}
        )
        for one in found.quantiles:
            value, interval = _quantile(one)
            below = f"  {100 * one.share:g} % below"
            rows.append({"metric": below, _VALUE: value, "interval": interval})
    order = ["metric", _VALUE, "interval", "deviation", "min", "median", "max", "runs"]
    present = [
        name
        for name in order
        if any(row.get(name) for row in rows) and (details or name not in ("deviation", "median"))
    ]
    headings = ["metric", *(f">{name}" for name in present[1:])]
    return table(headings, [[row.get(name, "") for name in present] for row in rows])


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
    value = f"{100 * found.share:.1f} %"
    if found.low is None or found.high is None:
        return value, ""
    return value, f"[{100 * found.low:.1f}, {100 * found.high:.1f}]"


def _mean(found: Numbers) -> tuple[str, str]:
    if found.low is None or found.high is None or found.low == found.high:
        return number(found.mean, 4), ""
    return number(found.mean, 4), f"[{found.low:.4g}, {found.high:.4g}]"


def _quantile(found: Quantile) -> tuple[str, str]:
    if found.low is None and found.high is None:
        return number(found.value, 4), ""
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
