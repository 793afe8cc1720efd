"""The rows of a run in memory: written as a trace is, and read as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Seconds
from cosim.trace.recorded_rows import Recorded
from cosim.trace.rows import layout
from cosim.trace.rows.hold import blanks
from cosim.trace.rows.layout import DTYPES, Signal
from cosim.trace.rows.rows import Lines, Poses, Rows
from cosim.trace.tables.growing import GrowingColumn
from cosim.trace.tables.table import Table
from cosim.trace.tables.topic_info import TopicInfo

Parts = Sequence[Rows | Poses | Lines]


class _Topic:
    """The rows of one topic so far: those joined in a table, and parts that came since."""

    def __init__(
        self, name: str, signals: Sequence[Signal], metadata: Mapping[str, str] | None
    ) -> None:
        self.name, self.signals, self.metadata = name, tuple(signals), metadata or {}
        self._parts: list[Rows] = []
        self._before: Table | None = None

    def __len__(self) -> int:
        before = 0 if self._before is None else len(self._before)
        return before + sum(part.log_ns.size for part in self._parts)

    def add(self, rows: Rows) -> None:
        """Take rows, as copies."""
        values = rows.values.copy() if isinstance(rows.values, np.ndarray) else [*rows.values]
        heads = rows.publish_ns.copy(), rows.sequence.copy()
        self._parts.append(Rows(rows.topic_id, rows.log_ns.copy(), values, *heads))

    def table(self) -> Table:
        """Return the rows so far."""
        if self._parts or self._before is None:
            self._before, self._parts = self._joined().after(self._before), []
        return self._before

    def _joined(self) -> Table:
        """Join the parts."""
        count = sum(part.log_ns.size for part in self._parts)
        heads = [GrowingColumn(np.int64, count) for _ in range(3)]
        columns = [GrowingColumn(DTYPES[signal.kind], count) for signal in self.signals]
        for part in self._parts:
            for head, own in zip(heads, (part.log_ns, part.publish_ns, part.sequence), strict=True):
                head.extend(own, None)
            for place, column in enumerate(columns):
                column.extend(*_values(part, place, column.values.dtype))
        log, publish, sequence = (head.values for head in heads)
        everywhere = np.ones(count, np.bool_)
        named = {s.name: column for s, column in zip(self.signals, columns, strict=True)}
        there = {name: column.present for name, column in named.items()}
        return Table(
            self.name,
            log,
            publish,
            sequence,
            {name: column.values for name, column in named.items()},
            {name: everywhere if mask is None else mask for name, mask in there.items()},
            {signal.name: signal for signal in self.signals},
        )


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
        self.ended = False
        self.log_lines: list[tuple[float, str, str, str]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.ended = True

    def __repr__(self) -> str:
        rows = sum(map(len, self._topics))
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
        self._topics.append(_Topic(topic, signals, metadata))
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
                self._topics[part.topic_id].add(part)

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
                len(topic),
                self._spans,
            )
            for topic in self._topics
        }

    def read_all(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: Seconds | None = None,
        end: Seconds | None = None,
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
            found[name] = known[name].table().within(start, end)
        return found

    def _spans(self) -> dict[str, tuple[int, int]]:
        tables = self.read_all()
        return {
            name: (int(table.log_time_ns.min()), int(table.log_time_ns.max()))
            for name, table in tables.items()
            if len(table)
        }


def _values(rows: Rows, place: int, dtype: np.dtype[Any]) -> tuple[Any, NDArray[np.bool_] | None]:
    """Return one column, and where it has a value; None for everywhere."""
    if isinstance(rows.values, np.ndarray):
        return rows.values[:, place], None
    listed = [row[place] for row in rows.values]
    there = np.array([value is not None for value in listed], np.bool_)
    if there.all():
        return listed, None
    blank = blanks(dtype, 1)[0]
    return [blank if value is None else value for value in listed], there
