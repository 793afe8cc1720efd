"""Read recordings of links from logs (text or Parquet) and MCAP files, and write them as CSV.

A log has a row for each message, in order of sending, and these columns in any order; a `LogFormat`
says how it is written, where that is another way:

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
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.core import AnyPath, InputError, counted, not_written, write_whole
from cosim.network import IN_FLIGHT_NS, LogFormat, Recording, no_rows, read_rows
from cosim.recordings.from_mcap import is_mcap, recordings_in
from cosim.recordings.log_columns import log_columns
from cosim.recordings.log_rows import OPTIONAL, LogRows, seconds_text
from cosim.recordings.plausibility import Plausibility, plausibility_of

MOST_ROWS = 2_000_000
"""More messages than this in one file are refused: they would fill the memory of a run."""


class ReadRecording(NamedTuple):
    """A recording as it was read, and whether it is plausible."""

    recording: Recording
    plausibility: Plausibility


def read_log(path: AnyPath, log_format: LogFormat | None = None) -> dict[str, ReadRecording]:
    """Read the recordings in a file with what is doubtful of each; nothing is printed.

    Raises
    ------
    InputError : as `read_recordings`.
    """
    written = log_format or LogFormat()
    if is_mcap(Path(path)):
        if written != LogFormat(hints=written.hints):
            raise InputError(
                "an MCAP file says itself how it is written",
                where=str(path),
                expected="a text file or Parquet file",
                got="a format of a log",
                hint="leave the format away",
            )
        return {
            name: ReadRecording(each, plausibility_of(each, written, unit=None, logged=False))
            for name, each in recordings_in(Path(path)).items()
        }
    columns = log_columns(path, written)
    found: dict[str, LogRows] = {}
    also = (*OPTIONAL, columns.maybe_sequence)
    optional = [name for name in also if name is not None and name not in columns.required]
    delimited = replace(written, delimiter=columns.delimiter)
    rows = read_rows(path, columns.required, optional, written=delimited)
    for count, row in enumerate(rows):
        name = row.cells.get("node", "")
        if name not in found:
            if "node" in row.cells and not name:
                raise InputError(
                    "a row without its node", where=row.where("node"), expected="a name", got="none"
                )
            found[name] = LogRows(columns, written)
        if count >= MOST_ROWS:
            raise InputError(
                "too many messages in one file",
                where=f"{path}, {row.place}",
                expected=f"at most {MOST_ROWS}",
                hint="split the file",
            )
        found[name].add(row)
    if not found:
        raise no_rows(path, "a line for each message")
    return {name: ReadRecording(*each.read()) for name, each in found.items()}


def read_recordings(path: AnyPath, log_format: LogFormat | None = None) -> dict[str, Recording]:
    """Read the recordings in a log, text or Parquet, or in an MCAP file, by the name of the link.

    The name is "" in a file of rows without the column `node`; in an MCAP file that is no trace the
    topics take the place of links: publish time is sending, log time arrival, and a gap in the
    sequence numbers is a loss. What looks wrong, such as delays of more than a minute, is asked
    about on standard error.

    Raises
    ------
    InputError : a file that cannot be read, or contains no messages; a bad cell, with its line and
        column; columns that have to be named, with the header.
    """
    found = read_log(path, log_format)
    for name, read in found.items():
        read.plausibility.ask(path, name)
    return {name: read.recording for name, read in found.items()}


def read_recording(
    path: AnyPath,
    node: str | None = None,
    default: str | None = None,
    log_format: LogFormat | None = None,
) -> Recording:
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

    Questions about anything that looks wrong are printed on standard error. A `LogFormat` says how
    a log is written.

    Raises
    ------
    InputError : as `read_recordings`; no such node, or several and none is chosen.
    """
    name, read = one_of(read_log(path, log_format), path, node, default)
    read.plausibility.ask(path, name)
    return read.recording


def one_of(
    found: Mapping[str, ReadRecording], path: AnyPath, node: str | None, default: str | None = None
) -> tuple[str, ReadRecording]:
    """Return the recording of `node`, of `default` if it is there, or the only one; and its name.

    Raises
    ------
    InputError : no such node, or several and none is chosen.
    """
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
    name = name if name is not None else next(iter(found))
    return name, found[name]


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
    times = [each for each in recordings.values() if each.delay_ns is not None]
    if times and len(times) < len(recordings):
        raise InputError(
            "recordings with and without times of arrival do not go into one file", where=str(path)
        )
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    names = ["sent", "delivered", "due"] if times else ["sent", "lost"]
    lines.writerow([*names, *(["node"] if several else [])])
    for name, each in recordings.items():
        for cells in _with_times(each) if times else _without_times(each):
            lines.writerow([*cells, name] if several else cells)
    with not_written("the recording", Path(path)):
        write_whole(Path(path), text.getvalue().encode())


def _with_times(recording: Recording) -> Iterator[list[str]]:
    """Yield the cells of sent, delivered and due."""
    sent_ns, delay_ns = recording.sent_ns + recording.start_ns, np.asarray(recording.delay_ns)
    columns = (sent_ns, delay_ns, recording.lost)
    for sent, delay, lost in zip(*(c.tolist() for c in columns), strict=True):
        then = seconds_text(sent + delay)
        came = "" if lost else "in flight" if delay == IN_FLIGHT_NS else then
        yield [seconds_text(sent), came, then if lost else ""]


def _without_times(recording: Recording) -> Iterator[list[str]]:
    """Yield the cells of sent and lost."""
    columns = (recording.sent_ns + recording.start_ns, recording.lost)
    for sent, lost in zip(*(c.tolist() for c in columns), strict=True):
        yield [seconds_text(sent), str(int(lost))]
