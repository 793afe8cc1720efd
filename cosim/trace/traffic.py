"""The messages of a link: how old they were, and which were not used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.hold import rows_in_force
from cosim.trace.layout import dropped_topic, link_topic
from cosim.trace.readable import Readable
from cosim.trace.table import Table


def link_names(trace: Readable) -> list[str]:
    """Names of the links of a trace, in order of appearance."""
    prefix = link_topic("")
    return [
        name.removeprefix(prefix)
        for name in trace.topics
        if name.startswith(prefix) and "/" not in name.removeprefix(prefix)
    ]


def deliveries(trace: Readable, link: str) -> Table:
    """What a link delivered: `log_time_ns` delivered, `publish_time_ns` sent.

    Raises
    ------
    InputError : no such link.
    """
    return trace.read(_known(trace, link, link_topic(link)))


def dropped(trace: Readable, link: str) -> Table:
    """What a link did not deliver, with its `reason`; `log_time_ns` is when it was due.

    Raises
    ------
    InputError : no such link.
    """
    return trace.read(_known(trace, link, dropped_topic(link)))


def age(
    trace: Readable, link: str, at: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Age [s] of the message in use over time [s]: the time since it was sent.

    Parameters
    ----------
    at : instants [s]; by default each delivery, before and after: the corners of the saw-tooth.
        NaN where no message is in use: before the first, and while the link's `on_loss` value
        stands in for one that was lost.

    Raises
    ------
    InputError : no such link.
    """
    table = deliveries(trace, link)
    arrived, sent = table.log_time_ns, table.publish_time_ns
    if at is None:
        corners = np.concatenate([arrived, arrived])
        before = np.arange(corners.size) < arrived.size
        order = np.lexsort((~before, corners))
        instants, early = corners[order], before[order]
        rows = np.where(early, np.searchsorted(np.sort(arrived), instants, side="left") - 1, 0)
        rows = np.where(early, rows, rows_in_force(arrived, instants))
    else:
        instants = np.rint(np.asarray(at, np.float64) * 1e9).astype(np.int64)
        rows = rows_in_force(arrived, instants)
    ages = np.full(instants.size, np.nan)
    known = rows >= 0
    ages[known] = (instants[known] - sent[rows[known]]) / 1e9
    substituted = _substituted(trace, link, table, rows, instants)
    ages[substituted] = np.nan
    return instants / 1e9, ages


def _substituted(
    trace: Readable, link: str, table: Table, rows: NDArray[np.int64], at_ns: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Where the value for lost messages was in use: lost, due since the last delivery, newer."""
    topic = dropped_topic(link)
    nowhere = np.zeros(at_ns.size, np.bool_)
    if trace.topics[link_topic(link)].metadata.get("on_loss", "hold") == "hold":
        return nowhere
    if topic not in trace.topics or not len(table):
        return nowhere
    lost = trace.read(topic)
    lost = lost.part(lost["reason"] == "lost")
    last = rows_in_force(lost.log_time_ns, at_ns)
    known = (last >= 0) & (rows >= 0)
    due, number = lost.log_time_ns[last[known]], lost.sequence[last[known]]
    nowhere[known] = (due >= table.log_time_ns[rows[known]]) & (
        number > table.sequence[rows[known]]
    )
    return nowhere


def _known(trace: Readable, link: str, topic: str) -> str:
    if topic not in trace.topics:
        raise InputError.unknown("link", link, link_names(trace), where=str(trace.path))
    return topic
