"""A trace as tables of other formats: CSV for everybody, Parquet for those who compute.

Long form: a table per topic, rows as they were recorded. Wide form: one table of all signals
chosen, side by side on the union of their instants, each with the value in force there (sample
and hold, `cosim.trace.frames`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cosim.core import InputError, Progress
from cosim.trace.content import content_hash_of
from cosim.trace.hold import rows_in_force, sample_and_hold
from cosim.trace.layout import signal_name
from cosim.trace.reader import Trace
from cosim.trace.table import Table
from cosim.trace.table_files import Column, Sheet, pyarrow, write_csv, write_parquet

Format = Literal["csv", "parquet"]
_EXACT = 2**53


@dataclass(frozen=True, slots=True)
class WrittenTable:
    """A file that was written."""

    path: Path
    topic: str | None
    rows: int
    columns: tuple[str, ...]


def export(
    path: Path,
    target: Path | None,
    to: Format,
    *,
    topics: Sequence[str] | None = None,
    signals: Sequence[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    wide: bool = False,
    report_progress: Progress | None = None,
) -> list[WrittenTable]:
    """Write a trace's rows as tables.

    Parameters
    ----------
    target : a file where there is one table (one topic, or `wide`), else a folder; beside the
        trace if None.
    topics : these alone; all that have columns by default.
    signals : these alone (`plant.eta.x`, or a group: `plant.eta`).
    start, end : least and greatest time of delivery [s].
    wide : one table, sample and hold.

    Raises
    ------
    InputError : nothing to write, names that do not exist, a place that cannot be written,
        pyarrow not installed.
    LossError : a damaged trace.
    """
    notify = report_progress or (lambda _what, _share: None)
    trace = Trace(path)
    chosen = _chosen(trace, topics, signals)
    arrow = pyarrow() if to == "parquet" else None
    single = wide or len(chosen) == 1
    if target is None:
        stem = trace.path.name.partition(".")[0]
        target = trace.path.with_name(f"{stem}.{to}" if single else f"{stem}-{to}")
    tables = trace.read_all(list(chosen), start=start, end=end) if wide else {}
    jobs: list[tuple[str | None, Path]] = [(None, target)]
    if not wide:
        names = _file_names(list(chosen))
        folder = target.is_dir() or not single
        jobs = [(t, target / f"{names[t]}.{to}" if folder else target) for t in chosen]
    content_hash = content_hash_of(trace)
    written = []
    for number, (topic, file) in enumerate(jobs):
        notify(f"writing {file.name}", number / len(jobs))
        if topic is None:
            sheet = _wide(tables, chosen)
        else:
            sheet = _long(trace.read(topic, start=start, end=end), chosen[topic])
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            if arrow is None:
                write_csv(file, sheet)
            else:
                write_parquet(arrow, file, sheet, trace, content_hash)
        except OSError as error:
            raise InputError(
                "the table cannot be written", where=str(file), got=str(error)
            ) from error
        written.append(WrittenTable(file, topic, sheet.rows, tuple(c.name for c in sheet.columns)))
    return written


def _chosen(
    trace: Trace, topics: Sequence[str] | None, signals: Sequence[str] | None
) -> dict[str, list[str] | None]:
    """Columns by topic; None: all of it."""
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
    found: dict[str, list[str] | None] = {}
    for wanted in signals:
        members = [
            place
            for name, place in trace.signals.items()
            if (name == wanted or name.startswith((f"{wanted}.", f"{wanted}[")))
            and place[0] in within
        ]
        if not members:
            topic, own = trace.place(wanted)
            found.setdefault(topic, [])
            columns = found[topic]
            if columns is not None:
                columns.append(own)
        for topic, signal in members:
            columns = found.setdefault(topic, [])
            if columns is not None and signal.name not in columns:
                columns.append(signal.name)
    return found


def _file_names(topics: list[str]) -> dict[str, str]:
    """A file name for each topic, `plant.output`, all different also without regard to case."""
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


def _long(table: Table, names: list[str] | None) -> Sheet:
    """time_s, sent_s, sequence, then the signals.

    Where the instants have more digits than a double (stamps of a wall clock), they come in
    nanoseconds too.
    """
    everywhere = np.ones(len(table), np.bool_)
    columns = [
        Column("time_s", "s", "time of delivery", table.delivered, everywhere),
        Column("sent_s", "s", "time of sending", table.sent, everywhere),
        Column("sequence", None, "sequence number", table.sequence, everywhere),
    ]
    if len(table) and int(table.log_time_ns.max()) > _EXACT:
        for name, times in (("time_ns", table.log_time_ns), ("sent_ns", table.publish_time_ns)):
            columns.append(Column(name, "ns", None, times, everywhere))
    taken = {column.name for column in columns}
    for name in table.columns if names is None else names:
        signal = table.signals.get(name)
        values = table[name]
        columns.append(
            Column(
                name if name not in taken else f"{name}_2",
                signal.unit if signal else None,
                signal.description if signal else None,
                values,
                table.present[name],
            )
        )
    return Sheet(table.topic, columns)


def _wide(tables: dict[str, Table], chosen: dict[str, list[str] | None]) -> Sheet:
    """time_s, then every signal by its full name."""
    base = np.unique(np.concatenate([table.log_time_ns for table in tables.values()]))
    everywhere = np.ones(base.size, np.bool_)
    columns = [Column("time_s", "s", "time", base / 1e9, everywhere)]
    for topic, names in chosen.items():
        table = tables[topic]
        for name in table.columns if names is None else names:
            values = table[name]
            there = table.present[name]
            rows = rows_in_force(table.log_time_ns[there], base)
            values, known = sample_and_hold(values[there], rows)
            signal = table.signals[name]
            columns.append(
                Column(signal_name(topic, name), signal.unit, signal.description, values, known)
            )
    return Sheet(None, columns)
