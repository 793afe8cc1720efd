"""Export a trace as tables: CSV, Parquet, or a MATLAB file.

Long form: a table per topic, with the rows as recorded. Wide form: one table of all signals chosen
at the union of their instants, each with the value in force there (sample and hold, as in
`cosim.trace.tables.frames`).
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cosim.core import AnyPath, InputError, Progress, Seconds, not_written, silent, written_beside
from cosim.trace.content import content_hash_of
from cosim.trace.exports.files import CsvFile, ParquetFile, Sheet
from cosim.trace.exports.mat_file import MatFile, bytes_of, check_size
from cosim.trace.reader import Trace
from cosim.trace.tables.arrow import pyarrow
from cosim.trace.tables.column import Column
from cosim.trace.tables.table import Table
from cosim.trace.tables.time_base import window_ns

Format = Literal["csv", "parquet", "mat"]
Jobs = list[tuple[str | None, Path]]
"""Topics and their files; of the wide form no topic."""
_EXACT = 2**53
_OPEN = 200
_PART_BYTES = 2**24
_WIDE = "signals"
_TOGETHER = 2**27
"""Bytes of tables that are gathered in one pass, for a file that takes each of them whole."""


@dataclass(frozen=True, slots=True)
class WrittenTable:
    """A table that was written to a file; `topic` is None for the wide form.

    A MATLAB file contains all tables.
    """

    path: Path
    topic: str | None
    rows: int
    columns: tuple[str, ...]


def export(
    path: AnyPath,
    target: AnyPath | None,
    to: Format,
    *,
    topics: Sequence[str] | None = None,
    signals: Sequence[str] | None = None,
    start: Seconds | None = None,
    end: Seconds | None = None,
    wide: bool = False,
    report_progress: Progress | None = None,
) -> list[WrittenTable]:
    """Write the rows of a trace as tables.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import export
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> written = export("lag.mcap", "lag.csv", "csv", topics=["/lag/output"])
        >>> written[0].path.name, written[0].rows, written[0].columns
        ('lag.csv', 11, ('time_s', 'sent_s', 'sequence', 'x[1]'))

    Parameters
    ----------
    target : a file for one table (one topic, or `wide`), else a folder; beside the trace if None.
        A file for all tables if `to` is "mat".
    to : CSV and Parquet are written part by part. A MATLAB file is written table by table: the
        largest table, or 128 MiB of smaller ones, is in memory about twice.
    topics : only these; by default all that have columns.
    signals : only these (`plant.eta.x`, or a group: `plant.eta`).
    start, end : least and greatest time of delivery [s].
    wide : one table of all signals, by sample and hold.

    Raises
    ------
    InputError : there is nothing to write, a topic or signal does not exist, a file cannot be
        written, a table is too large for the format, or pyarrow is not installed.
    LossError : the trace is damaged.
    """
    notify = report_progress or silent
    trace = Trace(path)
    chosen = _chosen(trace, topics, signals)
    arrow = pyarrow("Parquet needs pyarrow", otherwise="`to` csv") if to == "parquet" else None
    jobs = _places(trace, None if target is None else Path(target), to, chosen, wide=wide)
    content_hash = "" if to == "csv" else content_hash_of(trace)
    window = window_ns(start, end)

    def file_of(path: Path, sheet: Sheet) -> CsvFile | ParquetFile:
        if arrow is None:
            return CsvFile(path, sheet)
        return ParquetFile(arrow, path, sheet, trace, content_hash)

    def sheets_of(some: Jobs) -> Iterator[Sheet]:
        if wide:
            return _wide(trace, chosen, window)
        return _long(trace, {t: chosen[t] for t, _ in some if t}, (start, end), window)

    written: list[WrittenTable] = []
    # files are open at the same time: so many that no system refuses
    step = len(jobs) if to == "mat" else _OPEN
    for first in range(0, len(jobs), step):
        some = jobs[first : first + step]
        notify(f"writing {some[0][1].name}", first / len(jobs))
        with not_written("the table", some[0][1]):
            if to == "mat":
                written += _write_mat(trace, content_hash, some, sheets_of)
            else:
                written += _write(some, sheets_of(some), file_of)
    return written


def _places(
    trace: Trace, target: Path | None, to: Format, chosen: Collection[str], *, wide: bool
) -> Jobs:
    """Choose the file of each table."""
    single = wide or len(chosen) == 1 or to == "mat"
    stem = trace.path.name.partition(".")[0]
    if target is None:
        target = trace.path.with_name(f"{stem}.{to}" if single else f"{stem}-{to}")
    if to == "mat":
        whole = target / f"{stem}.mat" if target.is_dir() else target
        return [(topic, whole) for topic in ([None] if wide else chosen)]
    if wide:
        return [(None, target)]
    names = _file_names(list(chosen))
    folder = target.is_dir() or not single
    return [(t, target / f"{names[t]}.{to}" if folder else target) for t in chosen]


def _write_mat(
    trace: Trace, content_hash: str, jobs: Jobs, sheets_of: Callable[[Jobs], Iterator[Sheet]]
) -> Iterator[WrittenTable]:
    """Write all tables to one MATLAB file, as many in one pass as may be in memory together."""
    target = jobs[0][1]
    about = {
        "file": trace.path.name,
        "content_hash": content_hash,
        "content_hash_version": str(trace.content_hash_version),
        "run": json.dumps(trace.run, sort_keys=True),
    }
    with (
        written_beside(target) as partial,
        MatFile(partial, about, [topic or _WIDE for topic, _ in jobs]) as file,
    ):
        for some in _together(trace, jobs):
            parts: dict[str | None, list[list[Column]]] = {}
            sizes: Counter[str] = Counter()
            for sheet in sheets_of(some):
                parts.setdefault(sheet.topic, []).append(sheet.columns)
                table = sheet.topic or _WIDE
                sizes[table] += bytes_of(sheet.columns)
                check_size(table, sizes[table], trace.path)
            for topic, columns in parts.items():
                rows = sum(part[0].values.size for part in columns)
                written = WrittenTable(target, topic, rows, tuple(c.name for c in columns[0]))
                file.add(topic or _WIDE, columns)
                yield written


def _together(trace: Trace, jobs: Jobs) -> Iterator[Jobs]:
    """Yield tables in groups of about so many bytes."""
    some: Jobs = []
    filled = 0
    for topic, target in jobs:
        info = trace.topics.get(topic or "")
        size = 0 if info is None else 8 * info.count * (3 + len(info.signals))
        if some and filled + size > _TOGETHER:
            yield some
            some, filled = [], 0
        some.append((topic, target))
        filled += size
    yield some


def _write(
    jobs: Jobs,
    sheets: Iterator[Sheet],
    file_of: Callable[[Path, Sheet], CsvFile | ParquetFile],
) -> Iterator[WrittenTable]:
    """Write sheets to the files of their topics: the first of each is its columns, without rows.

    The files replace others when all of them are complete.
    """
    targets = dict(jobs)
    rows = dict.fromkeys(targets, 0)
    columns: dict[str | None, tuple[str, ...]] = {}
    with ExitStack() as stack:
        files: dict[str | None, CsvFile | ParquetFile] = {}
        with ExitStack() as opened:
            for sheet in sheets:
                topic = sheet.topic
                if topic not in files:
                    target = targets[topic]
                    files[topic] = file_of(stack.enter_context(written_beside(target)), sheet)
                    opened.callback(files[topic].close)
                    columns[topic] = tuple(column.name for column in sheet.columns)
                files[topic].append(sheet)
                rows[topic] += sheet.rows
    for topic, target in jobs:
        yield WrittenTable(target, topic, rows[topic], columns[topic])


def _chosen(
    trace: Trace, topics: Sequence[str] | None, signals: Sequence[str] | None
) -> dict[str, list[str] | None]:
    """Return the columns wanted of each topic; None stands for all."""
    readable = [t for t, info in trace.topics.items() if info.signals or info.encoding == "json"]
    for topic in topics or ():
        if topic not in trace.topics:
            raise InputError.unknown("topic", topic, trace.topics, where=str(trace.path))
    within = list(dict.fromkeys(topics)) if topics else readable
    if signals is None:
        if not within:
            raise InputError(
                "no topic has columns",
                where=str(trace.path),
                expected="protobuf or JSON topics",
                got=", ".join(trace.topics) or "no topics",
            )
        return dict.fromkeys(within, None)
    found: dict[str, list[str]] = {}
    for wanted in signals:
        places = [trace.place(name) for name in trace.members(wanted)]
        for topic, name in [place for place in places if place[0] in within] or places[:1]:
            if name not in found.setdefault(topic, []):
                found[topic].append(name)
    return dict(found)


def _file_names(topics: list[str]) -> dict[str, str]:
    """Choose a file name for each topic, `plant.output`; no two differ in case only."""
    names: dict[str, str] = {}
    taken: set[str] = set()
    for topic in topics:
        base = re.sub(r"[^A-Za-z0-9_-]+", ".", topic).strip(".") or "topic"
        name, number = base, 1
        while name.lower() in taken:
            number += 1
            name = f"{base}.{number}"
        taken.add(name.lower())
        names[topic] = name
    return names


def _long(
    trace: Trace,
    chosen: Mapping[str, list[str] | None],
    seconds: tuple[Seconds | None, Seconds | None],
    window: tuple[int, int],
) -> Iterator[Sheet]:
    """Yield the tables of topics part by part: time_s, sent_s, sequence, then the signals."""
    start, end = seconds
    streamed = [t for t in chosen if trace.topics[t].encoding == "protobuf"]
    fine = {t: min(trace.spans.get(t, (0, 0))[1], window[1]) > _EXACT for t in chosen}
    for topic in streamed:
        yield _rows(trace.empty(topic), chosen[topic], nanoseconds=fine[topic])
    for tables in trace.parts(streamed, start=start, end=end, part_bytes=_PART_BYTES):
        for topic, table in tables.items():
            yield _rows(table, chosen[topic], nanoseconds=fine[topic])
    for topic in chosen:  # the columns of JSON are known only when all rows are read
        if topic not in streamed:
            table = trace.read(topic, start=start, end=end)
            yield _rows(table, chosen[topic], nanoseconds=fine[topic])


def _rows(table: Table, names: list[str] | None, *, nanoseconds: bool) -> Sheet:
    """Make the table of one topic.

    Instants with more digits than a double (of a wall clock) are written in nanoseconds too.
    """
    everywhere = np.ones(len(table), np.bool_)
    columns = [
        Column("time_s", "s", "time of delivery", table.delivered, everywhere),
        Column("sent_s", "s", "time of sending", table.sent, everywhere),
        Column("sequence", None, "sequence number", table.sequence, everywhere),
    ]
    if nanoseconds:
        for name, times in (("time_ns", table.log_time_ns), ("sent_ns", table.publish_time_ns)):
            columns.append(Column(name, "ns", None, times, everywhere))
    taken = {column.name for column in columns}
    own = [
        table.column(name, full_name=f"{name}_2" if name in taken else None)
        for name in (table.columns if names is None else names)
    ]
    return Sheet(table.topic, [*columns, *own])


def _wide(
    trace: Trace, chosen: Mapping[str, list[str] | None], window: tuple[int, int]
) -> Iterator[Sheet]:
    """Yield the wide table window by window: time_s, then every signal by its full name."""
    whole = any(trace.topics[topic].encoding != "protobuf" for topic in chosen)
    borders = [] if whole else [b for b in trace.borders(_PART_BYTES) if b < window[1]]
    full = {(topic, signal.name): name for name, (topic, signal) in trace.signals.items()}
    in_force: dict[str, Table] = {}
    for tables in trace.windows(list(chosen), [*borders, window[1]], first_ns=window[0]):
        base = np.unique(np.concatenate([table.log_time_ns for table in tables.values()]))
        everywhere = np.ones(base.size, np.bool_)
        columns = [Column("time_s", "s", "time", base / 1e9, everywhere)]
        for topic, names in chosen.items():
            table = tables[topic].after(in_force.get(topic))
            for name in table.columns if names is None else names:
                full_name = full.get((topic, name), f"{topic}:{name}")
                columns.append(table.column(name, base, full_name=full_name))
            in_force[topic] = table.in_force()
        yield Sheet(None, columns)
