"""The rows of a run in memory: written as a trace is, and read as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from cosim.core import InputError
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
    """The rows of one topic so far."""

    def __init__(
        self, name: str, signals: Sequence[Signal], metadata: Mapping[str, str] | None
    ) -> None:
        self.name, self.signals, self.metadata = name, tuple(signals), metadata or {}
        self._heads = [GrowingColumn(np.int64, 0) for _ in range(3)]
        self._columns = [GrowingColumn(DTYPES[signal.kind], 0) for signal in signals]

    def __len__(self) -> int:
        return self._heads[0].values.size

    def add(self, rows: Rows) -> None:
        """Take rows, as copies."""
        for head, part in zip(
            self._heads, (rows.log_ns, rows.publish_ns, rows.sequence), strict=True
        ):
            head.extend(part, None)
        if isinstance(rows.values, np.ndarray):
            for place, column in enumerate(self._columns):
                column.extend(rows.values[:, place], None)
            return
        for column, values in zip(self._columns, zip(*rows.values, strict=True), strict=True):
            there = np.array([value is not None for value in values], np.bool_)
            blank = blanks(column.values.dtype, 1)[0]
            filled = [blank if value is None else value for value in values]
            column.extend(filled, None if there.all() else there)

    def table(self) -> Table:
        """Return the rows so far."""
        names = [signal.name for signal in self.signals]
        everywhere = np.ones(len(self), np.bool_)
        log, publish, sequence = (head.values for head in self._heads)
        present = [column.present for column in self._columns]
        return Table(
            self.name,
            log,
            publish,
            sequence,
            {name: column.values for name, column in zip(names, self._columns, strict=True)},
            {
                name: everywhere if there is None else there
                for name, there in zip(names, present, strict=True)
            },
            dict(zip(names, self.signals, strict=True)),
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
            found[name] = known[name].table().within(start, end)
        return found

    def _spans(self) -> dict[str, tuple[int, int]]:
        tables = self.read_all()
        return {
            name: (int(table.log_time_ns.min()), int(table.log_time_ns.max()))
            for name, table in tables.items()
            if len(table)
        }
