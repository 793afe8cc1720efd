"""Export a trace as tables: CSV or Parquet.

Long form: a table per topic, with the rows as recorded. Wide form: one table of all signals chosen
at the union of their instants, each with the value in force there (sample and hold, as in
`cosim.trace.frames`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from cosim.core import InputError, Progress, silent
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
    """A table that was written to a file; `topic` is None for the wide form."""

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
    """Write the rows of a trace as tables.

    Parameters
    ----------
    target : a file for one table (one topic, or `wide`), else a folder; beside the trace if None.
    topics : only these; by default all that have columns.
    signals : only these (`plant.eta.x`, or a group: `plant.eta`).
    start, end : least and greatest time of delivery [s].
    wide : one table of all signals, by sample and hold.

    Raises
    ------
    InputError : there is nothing to write, a topic or signal does not exist, a file cannot be
        written, or pyarrow is not installed.
    LossError : the trace is damaged.
    """
    notify = report_progress or silent
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


def _long(table: Table, names: list[str] | None) -> Sheet:
    """Make the table of one topic: time_s, sent_s, sequence, then the signals.

    Instants with more digits than a double (of a wall clock) are written in nanoseconds too.
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
        own = name if name not in taken else f"{name}_2"
        values, signal = table[name], table.signals[name]
        columns.append(Column(own, signal.unit, signal.description, values, table.present[name]))
    return Sheet(table.topic, columns)


def _wide(tables: dict[str, Table], chosen: dict[str, list[str] | None]) -> Sheet:
    """Make the wide table: time_s, then every signal by its full name."""
    base = np.unique(np.concatenate([table.log_time_ns for table in tables.values()]))
    everywhere = np.ones(base.size, np.bool_)
    columns = [Column("time_s", "s", "time", base / 1e9, everywhere)]
    for topic, names in chosen.items():
        table = tables[topic]
        for name in table.columns if names is None else names:
            there, signal = table.present[name], table.signals[name]
            rows = rows_in_force(table.log_time_ns[there], base)
            column = sample_and_hold(table[name][there], rows)
            own = signal_name(topic, name)
            columns.append(Column(own, signal.unit, signal.description, *column))
    return Sheet(None, columns)
