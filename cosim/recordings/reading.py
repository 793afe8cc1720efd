"""Read recordings of links from CSV, Parquet and MCAP files, and write them as CSV.

A CSV or Parquet file has a row for each message, in order of sending, and these columns in any
order:

* `sent`: when it was sent [s], by any clock;
* `delivered`: when it arrived [s], by the same clock; nothing, or "lost"; or "in flight" when the
  recording ended. In its place `delay` [s], or `lost` alone (1, or 0), without times;
* `due`: when a lost message would have arrived [s]; where it is empty, or not there, a lost
  message was under way as long as the last one that arrived before it;
* `node`: which link it is, where a file has several;
* `range` [m], or the places of both ends `from.x`, `from.y`, `from.z`, `to.x`, `to.y`, `to.z` [m];
* `size`: of the message, in any unit.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np

from cosim.core import AnyPath, InputError, counted, not_written, write_whole
from cosim.network import IN_FLIGHT_NS, Recording, Row, no_rows, read_rows
from cosim.recordings.from_mcap import is_mcap, recordings_in
from cosim.recordings.lost_messages import with_due

MOST_ROWS = 2_000_000
"""More messages than this in one file are refused: they would fill the memory of a run."""

_CLOCK = Decimal(2**63 - 1).scaleb(-9)
"""Latest instant of a recorder's clock [s]: seconds since 1970 fit."""
_PLACES = tuple((f"from.{axis}", f"to.{axis}") for axis in "xyz")
_OPTIONAL = (
    *("delivered", "delay", "lost", "due", "node", "range", "size"),
    *(name for pair in _PLACES for name in pair),
)
_LOST = {"": False, "0": False, "false": False, "1": True, "true": True}


def read_recordings(path: AnyPath) -> dict[str, Recording]:
    """Read the recordings in a CSV, Parquet or MCAP file, by the name of the link.

    The name is "" in a file of rows without the column `node`; in an MCAP file that is no trace the
    topics take the place of links: publish time is sending, log time arrival, and a gap in the
    sequence numbers is a loss.

    Raises
    ------
    InputError : a file that cannot be read, or contains no messages; a bad cell, with its line and
        column.
    """
    if is_mcap(Path(path)):
        return recordings_in(Path(path))
    found: dict[str, _Columns] = {}
    for row in read_rows(path, ("sent",), _OPTIONAL):
        name = row.cells.get("node", "")
        if name not in found:
            if "node" in row.cells and not name:
                raise InputError(
                    "a row without its node", where=row.where("node"), expected="a name", got="none"
                )
            found[name] = _Columns(_form(row))
        if sum(len(each.sent) for each in found.values()) >= MOST_ROWS:
            raise InputError(
                "too many messages in one file",
                where=f"{path}, {row.place}",
                expected=f"at most {MOST_ROWS}",
                hint="split the file",
            )
        found[name].add(row)
    if not found:
        raise no_rows(path, "a line for each message")
    return {name: each.recording() for name, each in found.items()}


def read_recording(path: AnyPath, node: str | None = None, default: str | None = None) -> Recording:
    """Read one recording; of a file with several, that of `node`, or of `default` if it is there.

        >>> from pathlib import Path
        >>> from cosim.recordings import read_recording
        >>> log = '''sent,delivered
        ... 0.0,0.3
        ... 1.0,
        ... 2.0,2.4
        ... '''
        >>> written = Path("link.csv").write_text(log)
        >>> recording = read_recording("link.csv")
        >>> recording.lost.tolist(), recording.delay_ns[recording.arrived].tolist()
        ([False, True, False], [300000000, 400000000])

    Raises
    ------
    InputError : as `read_recordings`; no such node, or several and none is chosen.
    """
    found = read_recordings(path)
    if node is not None and node not in found:
        names = [name for name in found if name]
        raise InputError.unknown("node", node, names, where=str(path))
    name = node if node is not None else default if default in found else None
    if name is None and len(found) > 1:
        listed = ", ".join(list(found)[:20])
        raise InputError(
            "the file has recordings of several links",
            where=str(path),
            expected=f"the name of one as node: {listed}",
            got=counted(len(found), "link"),
        )
    return found[name] if name is not None else next(iter(found.values()))


def write_recordings(path: AnyPath, recordings: Mapping[str, Recording]) -> None:
    """Write recordings as a CSV file for `read_recordings`; with `node` if there are several.

        >>> from cosim.network import Recording
        >>> from cosim.recordings import read_recording, write_recordings
        >>> second = 10**9
        >>> uplink = Recording([0, second, 2 * second], [False, True, False], [second // 4] * 3)
        >>> write_recordings("links.csv", {"uplink": uplink, "downlink": uplink})
        >>> read_recording("links.csv", node="downlink").lost.tolist()
        [False, True, False]

    Raises
    ------
    InputError : the file cannot be written.
    """
    several = len(recordings) > 1
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(["sent", "delivered", "due", *(["node"] if several else [])])
    for name, each in recordings.items():
        if each.delay_ns is None:
            raise InputError("without times of arrival there is nothing to write", where=str(path))
        columns = (each.sent_ns + each.start_ns, each.delay_ns, each.lost)
        for sent, delay, lost in zip(*(c.tolist() for c in columns), strict=True):
            then = _seconds(sent + delay)
            came = "" if lost else "in flight" if delay == IN_FLIGHT_NS else then
            cells = [_seconds(sent), came, then if lost else ""]
            lines.writerow([*cells, name] if several else cells)
    with not_written("the recording", Path(path)):
        write_whole(Path(path), text.getvalue().encode())


def _seconds(time_ns: int) -> str:
    whole, rest = divmod(abs(time_ns), 10**9)
    return f"{'-' if time_ns < 0 else ''}{whole}.{rest:09d}"


def _form(row: Row) -> str:
    """Return which column says what became of messages."""
    form = next((name for name in ("delivered", "delay", "lost") if name in row.cells), None)
    if form is None:
        raise InputError(
            "no column says what became of the messages",
            where=str(row.path),
            expected="a column delivered (s, empty where lost), delay (s) or lost (0 or 1)",
            got=", ".join(row.cells),
        )
    return form


@dataclass
class _Columns:
    """The rows of one link."""

    form: str
    sent: list[int] = field(default_factory=list)
    delay: list[int | None] = field(default_factory=list)
    lost: list[bool] = field(default_factory=list)
    range_m: list[float] = field(default_factory=list)
    size: list[float] = field(default_factory=list)

    def add(self, row: Row) -> None:
        sent = row.nanoseconds("sent", _CLOCK)
        if self.sent and sent < self.sent[-1]:
            raise InputError(
                "the messages are not in order of sending",
                where=row.where("sent"),
                expected=f"{_seconds(self.sent[-1])} s or later, as in the row before",
                got=f"{row.cells['sent']} s",
                hint="sort the rows by sent",
            )
        came = row.cells[self.form]
        in_flight, lost = came == "in flight", came in ("", "lost")
        if "lost" in row.cells:
            lost = self._flag(row, lost=lost)
        after: int | None = None
        if self.form == "lost":
            after = 0
        elif in_flight:
            after = IN_FLIGHT_NS
        elif not lost:
            after = self._after(row, self.form, sent)
        elif row.cells.get("due"):
            after = self._after(row, "due", sent)
        self.sent.append(sent)
        self.delay.append(after)
        self.lost.append(lost)
        self._add_range(row)
        if "size" in row.cells:
            self.size.append(row.number("size", "the size of the message"))

    def _flag(self, row: Row, *, lost: bool) -> bool:
        """Return what the column `lost` says, which must be what the other one says."""
        flag = _LOST.get(row.cells["lost"].lower())
        if flag is None:
            raise InputError(
                "this is neither lost nor not",
                where=row.where("lost"),
                expected="1 or true, 0 or false, or nothing",
                got=repr(row.cells["lost"]),
            )
        if self.form != "lost" and flag != lost:
            raise InputError(
                "two columns contradict each other",
                where=row.where("lost"),
                expected=f"{int(lost)}, since {self.form} is {row.cells[self.form] or 'empty'}",
                got=row.cells["lost"] or "nothing",
                hint="the time at which a lost message would have come is due",
            )
        return flag

    def _after(self, row: Row, column: str, sent: int) -> int:
        at = row.nanoseconds(column, _CLOCK)
        after = at if column == "delay" else at - sent
        if after < 0:
            raise InputError(
                "a message cannot arrive before it is sent",
                where=row.where(column),
                expected="0 s or more" if column == "delay" else f"{row.cells['sent']} s or later",
                got=f"{row.cells[column]} s",
                hint="are both times of one clock?",
            )
        return after

    def _add_range(self, row: Row) -> None:
        if "range" in row.cells:
            self.range_m.append(row.number("range", "the distance in m"))
            return
        pairs = [pair for pair in _PLACES if all(name in row.cells for name in pair)]
        if pairs:
            places = [[row.number(name, "a place in m") for name in pair] for pair in pairs]
            self.range_m.append(math.hypot(*(a - b for a, b in places)))

    def recording(self) -> Recording:
        sent = [instant - self.sent[0] for instant in self.sent]
        lost = np.array(self.lost)
        return Recording(
            np.array(sent, np.int64),
            lost,
            None if self.form == "lost" else with_due(self.delay),
            range_m=np.array(self.range_m) if self.range_m else None,
            size=np.array(self.size) if self.size else None,
            start_ns=self.sent[0],
        )
