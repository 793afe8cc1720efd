"""Comparisons, recoveries, checks, reports and injections of traces, as text (and JSON)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from cosim.cli.terminal import NONE, TONES, number, plain, table
from cosim.core import counted
from cosim.trace import comparison, rows as recorded

if TYPE_CHECKING:  # the help of `cosim trace` needs none
    from cosim.trace import Diff, Recovery, Verification
    from cosim.trace.report import ComparisonReport, Report

_MOST, _MOST_DAMAGE = 25, 20
_COLOURS = {"ok": "green", "failed": "bold red", "incomplete": "yellow", "not checked": "dim"}


def diff_view(found: Diff) -> RenderableType:
    """Show the differing signals and links, and how the two runs differ."""
    parts: list[RenderableType] = [
        plain(f"outcome: {change.a or NONE} | {change.b or NONE}")
        for change in found.context.entries
        if (change.where, change.key) == (recorded.RESULT, "headline")
    ]
    if found.identical:
        parts.append(Text(f"content hash {found.hashes[0]}"))
        return Group(*parts)
    parts += _signals(found)
    parts += [plain(line) for line in comparison.further_differences(found)]
    parts += _links(found)
    parts += _context(found)
    return Group(*parts)


def _signals(found: Diff) -> list[RenderableType]:
    parted = found.parted
    alike = len(found.signals) - len(parted)
    head = f"{len(parted)} of {len(found.signals)} signals differ, {alike} agree"
    parts: list[RenderableType] = [Text(head)]
    if not parted:
        return parts
    columns = (
        Column("signal", overflow="fold", min_width=24),
        *(">differs at", ">rows", ">of", ">largest", ">relative", ">at"),
    )
    rows = (
        (
            plain(signal.name),
            number(signal.first_s, 6, "s"),
            str(signal.differing),
            f"{signal.compared}{'*' if signal.sample_and_hold else ''}",
            "unlike" if signal.max_abs is None else number(signal.max_abs, 4, signal.unit or ""),
            number(signal.max_rel, 3),
            number(signal.max_at_s, 6, "s"),
        )
        for signal in parted[:_MOST]
    )
    parts.append(table(columns, rows))
    if len(parted) > _MOST:
        parts.append(Text(f"... and {len(parted) - _MOST} more (--json has all)"))
    if any(signal.sample_and_hold for signal in parted):
        parts.append(
            Text("* recorded at other instants: the values in force are compared at all of them")
        )
    return parts


def _links(found: Diff) -> list[RenderableType]:
    if not found.links:
        return []
    rows = (
        (
            plain(link.link),
            _both(link.delivered),
            _both(link.dropped),
            _both(link.only),
            str(link.other_times),
            number(link.largest_shift_s, 4, "s"),
            number(link.first_s, 6, "s"),
        )
        for link in found.links
    )
    return [table("link|>delivered|>dropped|>own|>other times|>by up to|>from", rows)]


def _both(pair: tuple[int, int]) -> str:
    return f"{pair[0]} / {pair[1]}"


def _context(found: Diff) -> list[RenderableType]:
    parts: list[RenderableType] = []
    for name, lines in found.context.texts.items():
        parts.append(plain(f"{name}:"))
        for line in lines:
            if not line.startswith(("--- ", "+++ ")):
                colour = {"+": "green", "-": "red"}.get(line[:1], "dim")
                parts.append(Text("  ").append_text(plain(line)))
                parts[-1].stylize(colour)  # type: ignore[union-attr]
    entries = [change for change in found.context.entries if change.informative]
    if entries:
        rows = (
            (plain(f"{x.where} {x.key}"), *(plain(NONE if v is None else v) for v in (x.a, x.b)))
            for x in entries[:_MOST]
        )
        columns = (Column(name, overflow="fold") for name in ("entry", "first", "second"))
        parts.append(table(columns, rows))
    more = len(found.context.entries) + found.context.left_out - min(len(entries), _MOST)
    if more:
        parts.append(Text(f"... and {more} more entries (--json has them)"))
    return parts


def recovery_line(found: Recovery) -> str:
    """Say what a recovery kept, and what was lost."""
    if found.complete:
        return f"nothing to recover: {found.output} has every message"
    if not found.lost:
        return f"recovered: {found.output}, {found.messages} messages, nothing lost"
    count = found.lost_messages
    lost = "an unknown number" if count is None else str(count)
    return f"recovered: {found.output}, {found.messages} messages; {lost} lost"


def recovery_view(found: Recovery) -> Table:
    """Show what the new file contains and what was lost."""
    view = Table.grid(padding=(0, 2))
    view.add_column(style="bold")
    view.add_column(overflow="fold")
    if found.complete:
        view.add_row("complete", plain("nothing to recover"))
    if found.failed:
        view.add_row("verify", plain(f"of the file given, it fails: {', '.join(found.failed)}"))
    view.add_row("output", plain(found.output))
    view.add_row(
        "kept",
        f"{found.messages} messages, {found.metadata} metadata records, "
        f"{found.attachments} attachments",
    )
    if found.suspect_messages:
        words = f"{found.suspect_messages} of these messages are of damaged chunks: they are marked"
        view.add_row("suspect", f"{words}, and may be wrong (--strict leaves them out)")
    unknown = "an unknown number of messages" if found.lost else "nothing"
    lost = unknown if found.lost_messages is None else f"{found.lost_messages} messages"
    view.add_row("lost", f"{lost if found.lost else 'nothing'}; {found.lost_bytes} bytes unused")
    view.add_row("run", "has its result" if found.finished else "has no result")
    for damage in found.damage[:_MOST_DAMAGE]:
        place = f"byte {damage.position}, {damage.length} bytes"
        view.add_row("damage", plain(f"{place}, {damage.outcome}: {damage.reason}"))
    if len(found.damage) > _MOST_DAMAGE:
        view.add_row("", f"and {len(found.damage) - _MOST_DAMAGE} more")
    return view


def verification_line(found: Verification) -> str:
    """Say whether a trace is whole and unchanged, and how many checks say so."""
    counts = [sum(check.verdict == word for check in found.checks) for word in ("ok", "failed")]
    if found.verdict == "ok":
        return f"{found.path}: all checks passed ({counts[0]})"
    if found.verdict == "failed":
        return f"{found.path}: {counts[1]} of {len(found.checks)} checks FAILED"
    return f"{found.path}: no check failed, but the file is not complete"


def verification_view(found: Verification, *, details: bool) -> Table:
    """Show a line for each check that did not pass; with `details` for every one."""
    view = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    view.add_column(style="bold", no_wrap=True)
    view.add_column(no_wrap=True)
    view.add_column(overflow="fold")
    passed = 0
    for check in found.checks:
        if check.verdict == "ok" and not details:
            passed += 1
            continue
        verdict = Text(check.verdict, style=_COLOURS[check.verdict])
        view.add_row(check.name, verdict, plain(check.detail))
    if passed:
        view.add_row("", Text("ok", _COLOURS["ok"]), f"{counted(passed, 'check')} (--details)")
    return view


def comparison_view(written: ComparisonReport) -> Text:
    """Show how the runs of a page of two traces ended, and whether they differ."""
    first, second = written.statuses
    return Text.assemble(
        f"the first: {first}\nthe second: {second}\n",
        (written.verdict, "green" if written.equal else "yellow"),
    )


def report_view(written: Report) -> Text:
    """Show the status of the run in a report, and its guarantee."""
    text = Text(f"the run: {written.status}")
    if written.guarantee is not None:
        check = written.guarantee
        text.append(f"\n{check.what}", style=TONES[check.tone]).append(f": {check.why}")
    return text
