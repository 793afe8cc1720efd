"""What recover and verify have found, for people."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from cosim.trace import Recovery

_MOST = 20


def plain(text: object) -> Text:
    """Text as it is: what is in a file is no markup and cannot steer the terminal."""
    return Text("".join(c if c.isprintable() else "\ufffd" for c in str(text)))


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
