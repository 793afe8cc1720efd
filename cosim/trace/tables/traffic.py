"""Read the messages of a link: delivered, dropped, and the age of the one in use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.rows.hold import rows_in_force
from cosim.trace.rows.layout import GREATEST_AGE, NOTICED_REASONS, dropped_topic, link_topic
from cosim.trace.tables.table import Table
from cosim.trace.tables.topic_info import Readable


def link_names(trace: Readable) -> list[str]:
    """Return the names of the links of a trace, in order of appearance."""
    prefix = link_topic("")
    names = [topic.removeprefix(prefix) for topic in trace.topics if topic.startswith(prefix)]
    return [name for name in names if "/" not in name]


def deliveries(trace: Readable, link: str) -> Table:
    """Read the messages that a link delivered, at `log_time_ns`; sent at `publish_time_ns`.

    Raises
    ------
    InputError : no such link.
    """
    return trace.read(_known(trace, link, link_topic(link)))


def dropped(trace: Readable, link: str) -> Table:
    """Read the messages that a link dropped, with the `reason`; they were due at `log_time_ns`.

    Raises
    ------
    InputError : no such link.
    """
    return trace.read(_known(trace, link, dropped_topic(link)))


def age(
    trace: Readable, link: str, at: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return instants [s] and the age [s] of the message in use there: the time since it was sent.

    The age is NaN where no message is in use: before the first, and while a lost message is
    replaced by the link's `on_loss` value (so is a late one, and one beyond `greatest_age`).

    Parameters
    ----------
    at : instants [s]; by default just before and at each delivery, the corners of the sawtooth,
        from the first delivery on.

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
    ages[_substituted(trace, link, table, rows, instants)] = np.nan
    first = 0 if at is not None else int(known.argmax())
    return instants[first:] / 1e9, ages[first:]


def loop_age(
    up: Table, down: Table, at_ns: NDArray[np.int64], step_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return instants [ns] and the age [s] of the measurement behind the command in force there.

    The command in force leads back to its own message, and that to the measurement which had
    reached the controller one step before the command was sent. NaN before the first command.

    Parameters
    ----------
    up, down : delivered measurements and commands.
    at_ns : instants [ns]; each delivery of a command, and the instant before it, are added.
    step_ns : communication step [ns].
    """
    arrivals = down.log_time_ns
    t = np.unique(np.concatenate([at_ns, arrivals, arrivals - 1]))
    command = np.searchsorted(arrivals, t, side="right") - 1
    sent = down.publish_time_ns[np.maximum(command, 0)]
    measured = np.searchsorted(up.log_time_ns, sent - step_ns, side="right") - 1
    age = (t - up.publish_time_ns[np.maximum(measured, 0)]) / 1e9
    return t, np.where((command >= 0) & (measured >= 0), age, np.nan)


def _substituted(
    trace: Readable, link: str, table: Table, rows: NDArray[np.int64], at_ns: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return where the substitute was in use.

    A newer message was lost since the last delivery, or the last one is too old.
    """
    topic = dropped_topic(link)
    substituted = np.zeros(at_ns.size, np.bool_)
    metadata = trace.topics[link_topic(link)].metadata
    if oldest := int(metadata.get(GREATEST_AGE, "0")):
        there = rows >= 0
        substituted[there] = at_ns[there] - table.publish_time_ns[rows[there]] >= oldest
    holds = metadata.get("on_loss", "hold") == "hold"
    if holds or topic not in trace.topics or not len(table):
        return substituted
    lost = trace.read(topic)
    lost = lost.part(np.isin(lost["reason"], NOTICED_REASONS))
    last = rows_in_force(lost.log_time_ns, at_ns)
    known = (last >= 0) & (rows >= 0)
    due, number = lost.log_time_ns[last[known]], lost.sequence[last[known]]
    in_use = rows[known]
    substituted[known] |= (due >= table.log_time_ns[in_use]) & (number > table.sequence[in_use])
    return substituted


def _known(trace: Readable, link: str, topic: str) -> str:
    if topic not in trace.topics:
        raise InputError.unknown("link", link, link_names(trace), where=trace.where)
    return topic
