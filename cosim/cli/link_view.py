"""Recorded links, formatted for a terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.terminal import NONE, facts, number, plain, table
from cosim.core import counted
from cosim.recordings import OUTAGE, LinkStatistics, ReadRecording

_MOST_LINES = 5
_BINS = ((1, 1), (2, 2), (3, 5), (6, 10), (11, 30), (31, 100), (101, None))
"""Lengths of runs that share a column of the table."""


def read_json(read: Mapping[str, ReadRecording]) -> dict[str, Any]:
    """Return what was read as plain JSON values, and what looks wrong in it."""
    return {"read": {name: each.plausibility.to_json() for name, each in read.items()}}


def read_lines(file: Path, read: Mapping[str, ReadRecording]) -> list[str]:
    """Say of each link in one line what was read."""
    return [f"{name or file}: {each.plausibility.line}" for name, each in read.items()]


def read_view(
    file: Path, read: Mapping[str, ReadRecording], *then: RenderableType
) -> RenderableType:
    """Show what was read of each link, and then the rest."""
    return Group(*map(plain, read_lines(file, read)), *then)


def record_json(file: Path, out: Path, read: Mapping[str, ReadRecording]) -> dict[str, Any]:
    """Return what was written as plain JSON values."""
    found = {name: each.recording for name, each in read.items()}
    return {
        "file": str(file),
        "out": str(out),
        "links": {
            name: {"messages": len(each), "lost": int(each.lost.sum()), "sha256": each.sha256}
            for name, each in found.items()
        },
        **read_json(read),
    }


def show_json(
    file: Path, described: Mapping[str, LinkStatistics], picture: Path | None
) -> dict[str, Any]:
    """Return the statistics as plain JSON values."""
    return {
        "file": str(file),
        "links": {name: asdict(each) for name, each in described.items()},
        "picture": None if picture is None else str(picture),
    }


def show_view(
    file: Path, described: Mapping[str, LinkStatistics], picture: Path | None
) -> RenderableType:
    """Show the statistics link by link."""
    parts: list[RenderableType] = []
    for name, each in described.items():
        parts += [Text(name or str(file), style="bold"), facts(*_facts(each)), _runs(each)]
        parts += [*_outages(each), Text()]
    if picture is not None:
        parts.append(plain(f"picture: {picture}"))
    return Group(*parts)


def _facts(found: LinkStatistics) -> Iterator[tuple[str, str, str]]:
    often = found.interval_s
    sent = "" if often is None else f", one each {often.median:.4g} s (median)"
    yield "messages", str(found.messages), f"in {found.duration_s:.4g} s{sent}"
    in_flight = found.messages - found.arrived - found.lost
    also = f"; {in_flight} still in flight at the end" if in_flight else ""
    yield "loss", _share(found.loss), f"{found.lost} lost, {found.arrived} arrived{also}"
    yield "P(loss | loss)", _share(found.loss_after_loss), "right after a lost message"
    yield "P(loss | ok)", _share(found.loss_after_arrival), "right after one that arrived"
    spread = found.delay_s
    if spread is None:
        yield "delay", NONE, "no times of arrival"
        return
    words = (
        f"mean; {spread.least:.4g} to {spread.greatest:.4g} s, half up to {spread.median:.4g} s, "
        f"95 % up to {spread.p95:.4g} s"
    )
    yield "delay", number(spread.mean, 4, "s"), words
    yield "", number(found.delay_correlation, 2), "correlation of each delay with the next"
    most = f"on average; at most {number(found.greatest_age_s, 4, 's')}"
    yield "age", number(found.mean_age_s, 4, "s"), most


def _share(share: float | None) -> str:
    return NONE if share is None else f"{100 * share:.3g} %"


def _runs(found: LinkStatistics) -> RenderableType:
    columns = ("*messages in a row", *(f">{_bin(*ends)}" for ends in _BINS), ">longest")
    rows = (
        (what, *(_within(runs, *ends) for ends in _BINS), str(max(runs, default=0)))
        for what, runs in (("lost", found.runs_of_losses), ("arrived", found.runs_of_arrivals))
    )
    return table(columns, rows)


def _within(runs: Mapping[int, int], low: int, high: int | None) -> str:
    return str(sum(n for k, n in runs.items() if low <= k and (high is None or k <= high)))


def _bin(low: int, high: int | None) -> str:
    return f"{low}+" if high is None else str(low) if low == high else f"{low}-{high}"


def _outages(found: LinkStatistics) -> list[RenderableType]:
    if not found.outages_s:
        return [Text(f"no outage ({OUTAGE} losses in a row or more)", style="dim")]
    longest = sorted(found.outages_s, key=lambda each: -each[1])[:_MOST_LINES]
    spent = sum(length for _, length in found.outages_s)
    share = spent / found.duration_s if found.duration_s else None
    head = f"{counted(len(found.outages_s), 'outage')} ({OUTAGE} losses in a row or more), "
    lines = [plain(f"{head}{_share(share)} of the time; the longest:")]
    return [*lines, *(plain(f"  {length:.4g} s, from {since:.6g} s") for since, length in longest)]
