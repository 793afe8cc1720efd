"""The age of the message of a link that is in use, and of the measurement behind a command."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cosim.trace.rows.hold import rows_in_force
from cosim.trace.rows.layout import GREATEST_AGE, NOTICED_REASONS
from cosim.trace.tables.table import Table


def age_in_use(
    delivered: Table,
    dropped: Table | None,
    metadata: Mapping[str, str],
    at: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return instants [s] and the age [s] of the message in use there: the time since it was sent.

    The age is NaN where no message is in use: before the first, and while a lost message is
    replaced by the link's `on_loss` value (so is a late one, and one beyond `greatest_age`).

    Parameters
    ----------
    delivered : the messages of a link.
    dropped : those that it dropped, with the `reason`; None where a lost value is held.
    metadata : of the topic of those delivered.
    at : instants [s]; by default just before and at each delivery, the corners of the sawtooth,
        from the first delivery on.
    """
    arrived, sent = delivered.log_time_ns, delivered.publish_time_ns
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
    ages[_substituted(delivered, dropped, metadata, rows, instants)] = np.nan
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
    delivered: Table,
    dropped: Table | None,
    metadata: Mapping[str, str],
    rows: NDArray[np.int64],
    at_ns: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Return where the substitute was in use.

    A newer message was lost since the last delivery, or the last one is too old.
    """
    substituted = np.zeros(at_ns.size, np.bool_)
    if oldest := int(metadata.get(GREATEST_AGE, "0")):
        there = rows >= 0
        substituted[there] = at_ns[there] - delivered.publish_time_ns[rows[there]] >= oldest
    if dropped is None or not len(delivered):
        return substituted
    lost = dropped.part(np.isin(dropped["reason"], NOTICED_REASONS))
    last = rows_in_force(lost.log_time_ns, at_ns)
    known = (last >= 0) & (rows >= 0)
    due, number = lost.log_time_ns[last[known]], lost.sequence[last[known]]
    arrived, sent = delivered.log_time_ns[rows[known]], delivered.sequence[rows[known]]
    substituted[known] |= (due >= arrived) & (number > sent)
    return substituted
