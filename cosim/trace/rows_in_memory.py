"""The rows of a run in memory: written as a trace is, and read as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.recorded_rows import Recorded
from cosim.trace.rows import layout
from cosim.trace.rows.hold import blanks
from cosim.trace.rows.layout import DTYPES, Signal
from cosim.trace.rows.rows import Lines, Poses, Rows
from cosim.trace.tables.join import window_ns
from cosim.trace.tables.table import Table
from cosim.trace.tables.topic_info import TopicInfo

Parts = Sequence[Rows | Poses | Lines]


@dataclass
class _Topic:
    """The rows of one topic so far."""

    name: str
    signals: tuple[Signal, ...]
    metadata: Mapping[str, str]
    parts: list[Rows] = field(default_factory=list)

    @property
    def count(self) -> int:
        return sum(part.log_ns.size for part in self.parts)


class RowsInMemory(Recorded):
    """The rows of components and links of a run, kept in memory.

    It takes what a `TraceWriter` takes, and is read as a `Trace`. What follows from other rows,
    as the scene, and the log have no rows here; `log_lines` has those of the log.

    Attributes
    ----------
    ended : whether the run is over.
    log_lines : time [s], level, name and message of each line.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._topics: list[_Topic] = []
        self._tables: dict[str, Table] = {}
        self.ended = False
        self.log_lines: list[tuple[float, str, str, str]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.ended = True

    def __repr__(self) -> str:
        rows = sum(map(self._count, self._topics))
        return f"<RowsInMemory {self._name}: {len(self._topics)} topics, {rows} rows>"

    @property
    def where(self) -> str:
        """The name of the run."""
        return self._name

    def add_topic(
        self,
        topic: str,
        signals: Sequence[Signal],
        *,
        schema_name: str,  # noqa: ARG002 - of messages in a file
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Declare a topic, as `TraceWriter.add_topic`; return its id."""
        self._topics.append(_Topic(topic, tuple(signals), metadata or {}))
        return len(self._topics) - 1

    def add_dropped_topic(self, link: str) -> int:
        """Declare the topic of a link's dropped messages; return its id."""
        return self.add_topic(layout.dropped_topic(link), layout.DROPPED_SIGNALS, schema_name="")

    def write_rows(self, parts: Parts) -> None:
        """Take rows of several topics; the arrays are copied."""
        for part in parts:
            if isinstance(part, Lines):
                for time_ns, line in zip(part.log_ns.tolist(), part.lines, strict=True):
                    self.log(time_ns, *line)
            elif isinstance(part, Rows) and part.log_ns.size:
                values = part.values
                own = values.copy() if isinstance(values, np.ndarray) else [*values]
                heads = (part.publish_ns.copy(), part.sequence.copy())  # of a child, perhaps
                kept = Rows(part.topic_id, part.log_ns.copy(), own, *heads)
                self._topics[part.topic_id].parts.append(kept)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Take a line of the log."""
        self.log_lines.append((time_ns / 1e9, level, name, message))

    def flush(self) -> None:
        """Do nothing: rows in memory are read when the run is over."""

    def finish(self, _: Mapping[str, str]) -> None:
        """End: what the result says is in the outcome that has these rows."""
        self.ended = True

    @property
    def content_hash(self) -> None:
        """None: only a file has one."""

    @property
    def topics(self) -> dict[str, TopicInfo]:  # type: ignore[override]
        """The description of every topic, by its name."""
        return {
            topic.name: TopicInfo(
                topic.name,
                topic.signals,
                topic.metadata,
                self._count(topic),
                self._spans,
            )
            for topic in self._topics
        }

    def read_all(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: float | None = None,
        end: float | None = None,
    ) -> dict[str, Table]:
        """Read several topics, all if None.

        start, end : least and greatest time of delivery [s]; all by default.

        Raises
        ------
        InputError : no such topic.
        """
        known = {topic.name: topic for topic in self._topics}
        found = {}
        for name in known if topics is None else topics:
            if name not in known:
                raise InputError.unknown("topic", name, known, where=self.where)
            table = self._tables.get(name)
            if table is None:
                table = _table(known[name])
                if self.ended:  # once, in place of its parts
                    self._tables[name] = table
                    known[name].parts.clear()
            if start is not None or end is not None:
                low, high = window_ns(start, end)
                table = table.part((table.log_time_ns >= low) & (table.log_time_ns <= high))
            found[name] = table
        return found

    def _count(self, topic: _Topic) -> int:
        table = self._tables.get(topic.name)
        return topic.count if table is None else len(table)

    def _spans(self) -> dict[str, tuple[int, int]]:
        tables = self.read_all()
        return {
            name: (int(table.log_time_ns.min()), int(table.log_time_ns.max()))
            for name, table in tables.items()
            if len(table)
        }


def _table(topic: _Topic) -> Table:
    """Return the rows of a topic as a table."""
    empty = np.zeros(0, np.int64)
    log, publish, sequence = (
        np.concatenate([empty, *(getattr(part, key) for part in topic.parts)]).astype(np.int64)
        for key in ("log_ns", "publish_ns", "sequence")
    )
    columns: dict[str, NDArray[Any]] = {}
    present: dict[str, NDArray[np.bool_]] = {}
    for place, signal in enumerate(topic.signals):
        pieces = [_column(part.values, place, signal) for part in topic.parts]
        columns[signal.name] = np.concatenate(
            [blanks(DTYPES[signal.kind], 0), *(values for values, _ in pieces)]
        )
        present[signal.name] = np.concatenate(
            [np.zeros(0, np.bool_), *(there for _, there in pieces)]
        )
    signals = {signal.name: signal for signal in topic.signals}
    return Table(topic.name, log, publish, sequence, columns, present, signals)


def _column(
    values: NDArray[np.float64] | Sequence[Sequence[Any]], place: int, signal: Signal
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return one column, and where it has a value."""
    if isinstance(values, np.ndarray):
        column = values[:, place]
        kept = column if signal.kind == "float" else column.astype(DTYPES[signal.kind])
        return kept, np.ones(column.size, np.bool_)
    listed = [row[place] for row in values]
    there = np.array([value is not None for value in listed], np.bool_)
    blank = blanks(DTYPES[signal.kind], 1)[0]
    filled = [blank if value is None else value for value in listed]
    return np.array(filled, DTYPES[signal.kind]), there
