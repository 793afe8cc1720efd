"""What recover and verify have found, for people."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cosim.cli.terminal import plain
from cosim.trace import Recovery, Verification

_MOST = 20


def recovery_view(found: Recovery) -> Table:
    """Where the new file is, what is in it, what is not."""
    view = Table.grid(padding=(0, 2))
    view.add_column(style="bold")
    view.add_column(overflow="fold")
    if found.complete:
        view.add_row("whole", plain("nothing to recover"))
    view.add_row("output", plain(found.output))
    view.add_row(
        "kept",
        f"{found.messages} messages, {found.metadata} metadata records, "
        f"{found.attachments} attachments",
    )
    unknown = "an unknown number of messages" if found.lost else "nothing"
    lost = unknown if found.lost_messages is None else f"{found.lost_messages} messages"
    view.add_row("lost", f"{lost if found.lost else 'nothing'}; {found.lost_bytes} bytes unused")
    view.add_row("run", "came to its result" if found.finished else "has no result")
    for damage in found.damage[:_MOST]:
        place = f"byte {damage.position}, {damage.length} bytes"
        view.add_row("damage", plain(f"{place}: {damage.reason}"))
    if len(found.damage) > _MOST:
        view.add_row("", f"and {len(found.damage) - _MOST} more")
    return view


_COLOURS = {"ok": "green", "failed": "bold red", "incomplete": "yellow", "not checked": "dim"}
_WORDS = {
    "ok": "everything that was checked is right",
    "failed": "NOT what it says",
    "incomplete": "right as far as it goes, but not complete",
}


def verification_view(found: Verification) -> Group:
    """One line per check, then the verdict."""
    view = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    view.add_column(style="bold", no_wrap=True)
    view.add_column(no_wrap=True)
    view.add_column(overflow="fold")
    for check in found.checks:
        verdict = Text(check.verdict, style=_COLOURS[check.verdict])
        view.add_row(check.name, verdict, plain(check.detail))
    last = plain(f"{found.path}: {_WORDS[found.verdict]}")
    last.stylize(_COLOURS[found.verdict])
    return Group(view, last)
