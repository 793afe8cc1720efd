"""A summary of a trace, for programs (`describe`) and for people (`render`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.table import Table as RichTable
from rich.text import Text

from cosim.trace.content import content_hash_of
from cosim.trace.layout import HOST_PREFIX
from cosim.trace.reader import Trace

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from cosim.trace.reader import TopicInfo

_LINK = "link."


def describe(path: str | PathLike[str], *, incomplete: bool | None = True) -> dict[str, Any]:
    """Return what a trace holds, JSON-safe (no NaN; None for what is not there).

    Keys: `path`, `bytes`, `library`, `complete`, `damage`, `finished`, `run`, `result`
    (entries but those of links), `links` (by link name: its figures), `start_ns`, `end_ns`,
    `message_count`, `topics` (list of `topic`, `schema`, `encoding`, `count`, `start_ns`,
    `end_ns`, `rate_hz`, `signals`), `attachments` (list of `name`, `media_type`, `bytes`),
    `content_hash`.

    `incomplete` as in `Trace`, but True by default: to find out what happened is the point.
    """
    trace = Trace(path, incomplete=incomplete)
    topics = [_topic(info) for info in trace.topics.values()]
    starts = [t["start_ns"] for t in topics if t["start_ns"] is not None]
    ends = [t["end_ns"] for t in topics if t["end_ns"] is not None]
    links, result = _split(trace.result)
    return {
        "path": str(trace.path),
        "bytes": trace.path.stat().st_size,
        "library": trace.library,
        "complete": trace.complete,
        "damage": trace.damage,
        "finished": trace.finished,
        "run": dict(trace.run),
        "result": result,
        "links": links,
        "start_ns": min(starts, default=None),
        "end_ns": max(ends, default=None),
        "message_count": sum(t["count"] for t in topics),
        "topics": topics,
        "attachments": [
            {"name": name, "media_type": trace.media_types[name], "bytes": len(data)}
            for name, data in trace.attachments.items()
        ],
        "content_hash": content_hash_of(trace),
    }


def render(description: Mapping[str, Any]) -> Group:
    """Return a `describe` dictionary as something rich can print."""
    parts: list[Any] = [
        _facts(description),
        _topics(description["topics"]),
    ]
    if description["links"]:
        parts.append(_links(description["links"]))
    return Group(*parts)


def _topic(info: TopicInfo) -> dict[str, Any]:
    rate = None
    if info.start_ns is not None and info.end_ns is not None and info.end_ns > info.start_ns:
        rate = (info.count - 1) * 1e9 / (info.end_ns - info.start_ns)
    return {
        "topic": info.topic,
        "schema": info.schema,
        "encoding": info.encoding,
        "count": info.count,
        "start_ns": info.start_ns,
        "end_ns": info.end_ns,
        "rate_hz": rate,
        "signals": [
            {
                "name": signal.name,
                "kind": signal.kind,
                "unit": signal.unit,
                "value_reference": signal.value_reference,
                "hold": signal.hold,
            }
            for signal in info.signals
        ],
    }


def _split(
    result: Mapping[str, str] | None,
) -> tuple[dict[str, dict[str, str]], dict[str, str] | None]:
    """Take the entries `link.<name>.<figure>` out of the result."""
    if result is None:
        return {}, None
    links: dict[str, dict[str, str]] = {}
    rest: dict[str, str] = {}
    for key, value in result.items():
        link, dot, figure = key.removeprefix(_LINK).rpartition(".")
        if key.startswith(_LINK) and dot:
            links.setdefault(link, {})[figure] = value
        else:
            rest[key] = value
    return links, rest


def _text(value: object) -> Text:
    """Text as it is: brackets are no markup, and what is in a file cannot steer the terminal."""
    return Text("".join(c if c.isprintable() else "\ufffd" for c in str(value)))


def _facts(description: Mapping[str, Any]) -> RichTable:
    facts = RichTable.grid(padding=(0, 2))
    facts.add_column(style="bold")
    facts.add_column(overflow="fold")

    def row(name: str, value: object) -> None:
        facts.add_row(_text(name), _text(value))

    row("trace", f"{description['path']} ({description['bytes']} bytes)")
    state = "finished" if description["finished"] else "the run did not finish"
    row("state", state if description["complete"] else f"{state}; {description['damage']}")
    if description["start_ns"] is not None:
        row("time", f"{description['start_ns'] / 1e9:g} s to {description['end_ns'] / 1e9:g} s")
    row("content", description["content_hash"])
    run = description["run"]
    for key in sorted(run, key=lambda key: (key.startswith(HOST_PREFIX), key)):
        row(key, run[key])
    for key, value in (description["result"] or {}).items():
        row(f"result {key}", value)
    for item in description["attachments"]:
        row("attached", f"{item['name']} ({item['media_type']}, {item['bytes']} bytes)")
    return facts


def _topics(topics: list[dict[str, Any]]) -> RichTable:
    table = RichTable(box=None, padding=(0, 2, 0, 0))
    table.add_column("topic")
    table.add_column("messages", justify="right")
    table.add_column("rate [1/s]", justify="right")
    table.add_column("signals", overflow="fold")
    for topic in topics:
        rate = "" if topic["rate_hz"] is None else f"{topic['rate_hz']:g}"
        signals = ", ".join(
            f"{s['name']} [{s['unit']}]" if s["unit"] else s["name"] for s in topic["signals"]
        )
        table.add_row(
            _text(topic["topic"]), str(topic["count"]), rate, _text(signals or topic["schema"])
        )
    return table


def _links(links: Mapping[str, Mapping[str, str]]) -> RichTable:
    figures = list(dict.fromkeys(figure for link in links.values() for figure in link))
    table = RichTable(box=None, padding=(0, 2, 0, 0))
    table.add_column("link")
    for figure in figures:
        table.add_column(_text(figure), justify="right")
    for name, link in links.items():
        table.add_row(_text(name), *(_text(link.get(figure, "")) for figure in figures))
    return table
