"""Check the messages of links against what was sent, declared and counted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.check_results import Check, check_result
from cosim.trace.layout import output_topic
from cosim.trace.reader import Table


@dataclass(frozen=True)
class Link:
    """A link as the trace has it.

    Attributes
    ----------
    delivered, dropped : its messages; None without such a topic.
    declared : the link as `cosim.run` describes it, and its order.
    figures : its figures in `cosim.result`; empty without a result.
    """

    name: str
    delivered: Table
    dropped: Table | None
    declared: Mapping[str, Any]
    figures: Mapping[str, str]


def checks_of_links(
    links: Sequence[Link], tables: Mapping[str, Table], *, whole: bool
) -> Iterator[Check]:
    """Yield one check of each kind for all links together."""
    if not links:
        yield Check("links", "not checked", "the run has none")
        return
    names = ", ".join(link.name for link in links)
    for name, check, fine in (
        (
            "link delays",
            _early,
            "no message was delivered before the link's delay or play-out was over",
        ),
        ("link sequence", _sequence, "sequence numbers follow the order of the link"),
        ("link fates", _accounting, "every message was delivered, dropped or in flight, once"),
    ):
        problems = [f"{link.name}: {what}" for link in links for what in check(link)]
        yield check_result(name, problems, f"{names}: {fine}")
    problems = [f"{link.name}: {what}" for link in links for what in _values(link, tables)]
    yield check_result("link values", problems, f"{names}: values delivered are those sent")
    if whole:
        problems = [f"{link.name}: {what}" for link in links for what in _figures(link)]
        yield check_result("link counts", problems, f"{names}: counts as in the result")


def _numbers(table: Table | None) -> NDArray[np.int64]:
    return np.zeros(0, np.int64) if table is None else table.sequence


def _early(link: Link) -> Iterator[str]:
    stated = (link.declared.get(key, 0) for key in ("delay_ns", "playout_ns"))
    least = max((each for each in stated if isinstance(each, int)), default=0)
    transit = link.delivered.log_time_ns - link.delivered.publish_time_ns
    if (transit < least).any():
        i = int(np.argmax(transit < least))
        number = link.delivered.sequence[i]
        yield f"message {number} took {transit[i]} ns, the link's delay or play-out is {least} ns"


def _sequence(link: Link) -> Iterator[str]:
    """Check that numbers grow in order of delivery, unless the order is as-arrived."""
    numbers, sent = link.delivered.sequence, link.delivered.publish_time_ns
    if link.declared.get("order") in ("newest-wins", "fifo"):
        # of two copies, newest-wins drops the later one, fifo delivers both
        again = link.declared.get("order") == "fifo" and link.declared.get("duplicate")
        least = 0 if again else 1
        back = np.flatnonzero(np.diff(numbers) < least)
        if back.size:
            i = int(back[0])
            yield f"message {numbers[i + 1]} was delivered after {numbers[i]}"
    by_number = np.argsort(numbers, kind="stable")
    if (np.diff(sent[by_number]) < 0).any():
        yield "a message was sent before one with a lower number"


def _accounting(link: Link) -> Iterator[str]:
    """Check that a message, and its copy if there is one, is delivered or dropped once."""
    most = 2 if link.declared.get("duplicate") else 1
    numbers = np.concatenate([_numbers(link.delivered), _numbers(link.dropped)])
    found, counts = np.unique(numbers, return_counts=True)
    if (counts > most).any():
        number, count = found[counts > most][0], counts[counts > most][0]
        yield f"message {number} was delivered or dropped {count} times"


def _figures(link: Link) -> Iterator[str]:
    stated = {key: int(v) for key, v in link.figures.items() if v.isdecimal()}
    delivered, dropped = _numbers(link.delivered), _numbers(link.dropped)
    if not {"sent", "delivered", "dropped", "in_flight"} <= set(stated):
        if delivered.size + dropped.size:  # a run of no steps has none
            yield "the result has no figures of it"
        return
    for what, found in (("delivered", delivered), ("dropped", dropped)):
        if found.size != stated[what]:
            yield f"{found.size} messages {what}, the result says {stated[what]}"
    total = stated["delivered"] + stated["dropped"] + stated["in_flight"]
    if stated["sent"] + stated.get("duplicated", 0) != total:
        yield f"{stated['sent']} messages sent, but {total} delivered, dropped or in flight"
    known = np.union1d(delivered, dropped)
    missing = np.setdiff1d(np.arange(stated["sent"]), known).size
    copies = bool(link.declared.get("duplicate"))  # a copy may be in flight, its message not
    if missing > stated["in_flight"] or (missing < stated["in_flight"] and not copies):
        yield f"{missing} messages in flight, the result says {stated['in_flight']}"
    if known.size and known[-1] >= stated["sent"]:
        yield f"there is message {known[-1]}, the result says {stated['sent']} were sent"


def _values(link: Link, tables: Mapping[str, Table]) -> Iterator[str]:
    """Check that every value is the sender's at the instant of sending, quantized by the link."""
    step = link.declared.get("quantization", 0.0)
    for name, values in link.delivered.columns.items():
        sender = _sender(name, tables)
        if sender is None:
            yield f"{name} is no output in this trace"
            continue
        table, variable = sender
        # sample and hold, in file order: rows out of order are another check's finding
        rows = np.searchsorted(table.log_time_ns, link.delivered.publish_time_ns, "right") - 1
        there = rows >= 0
        if not there.all():
            i = int(np.argmin(there))
            yield f"{name}: message {link.delivered.sequence[i]} was sent before the sender's rows"
        expected = table.columns[variable][rows[there]]
        if isinstance(step, int | float) and step and expected.dtype.kind == "f":
            expected = np.rint(expected / step) * step
        got = values[there]
        differs = got != expected
        if got.dtype.kind == "f":
            differs &= ~(np.isnan(got) & np.isnan(expected))
        if differs.any():
            i = int(np.argmax(differs))
            number = link.delivered.sequence[there][i]
            yield f"{name}: message {number} has {got[i]!r}, sent was {expected[i]!r}"


def _sender(name: str, tables: Mapping[str, Table]) -> tuple[Table, str] | None:
    """Return rows and column of `component.variable`; both names may have dots."""
    parts = name.split(".")
    for i in range(1, len(parts)):
        table, variable = tables.get(output_topic(".".join(parts[:i]))), ".".join(parts[i:])
        if table is not None and variable in table.columns:
            return table, variable
    return None
