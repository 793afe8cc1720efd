"""What is read of a recorded run by the names of its signals, in a file or in memory."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Seconds, is_inside
from cosim.trace.rows import layout
from cosim.trace.rows.layout import Signal
from cosim.trace.tables import traffic
from cosim.trace.tables.column import Align, Between, Joined
from cosim.trace.tables.frames import Framed
from cosim.trace.tables.join import joined
from cosim.trace.tables.series_plot import draw_rows
from cosim.trace.tables.table import Series, Table, group_of, series_of
from cosim.trace.tables.topic_info import TopicInfo


class Recorded(Framed):
    """A recorded run: its signals by name, its topics as tables, its links.

    As a data frame, an Arrow table or a dataset: see `cosim.trace.tables.frames.Framed`.

    Attributes
    ----------
    topics : `TopicInfo` by topic, in order of appearance.
    """

    topics: dict[str, TopicInfo]

    @property
    @abstractmethod
    def where(self) -> str:
        """What it is read from, for messages."""

    @abstractmethod
    def read_all(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: Seconds | None = None,
        end: Seconds | None = None,
    ) -> dict[str, Table]:
        """Read several topics (all protobuf topics if None) in one pass.

        start, end : least and greatest time of delivery [s]; all by default.
        """

    def _repr_html_(self) -> str:
        """Return the line of `repr` and a table of the topics, as notebooks show it."""
        rows = []
        for topic, info in self.topics.items():
            signals = ", ".join(f"{s.name} [{s.unit}]" if s.unit else s.name for s in info.signals)
            cells = (topic, info.count, signals or f"{info.schema} ({info.encoding})")
            rows.append("".join(f"<td>{escape(str(cell))}</td>" for cell in cells))
        head = "".join(f"<th>{name}</th>" for name in ("topic", "messages", "signals"))
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<p>{escape(repr(self)[1:-1])}</p><table><tr>{head}</tr>{body}</table>"

    @functools.cached_property
    def signals(self) -> dict[str, tuple[str, Signal]]:
        """Topic and description of every protobuf signal, by the name `signal` takes.

        `component.variable` for outputs and inputs of components, `TOPIC:name` for the rest, and
        for an input of the same name as an output.
        """
        found: dict[str, tuple[str, Signal]] = {}
        for topic, info in self.topics.items():
            for signal in info.signals:
                name = layout.signal_name(topic, signal.name)
                found[f"{topic}:{signal.name}" if name in found else name] = topic, signal
        return found

    def place(self, name: str) -> tuple[str, str]:
        """Return the topic of a signal, and its name within the topic.

        Raises
        ------
        InputError : no such signal.
        """
        if name in self.signals:
            topic, signal = self.signals[name]
            return topic, signal.name
        topic, colon, own = name.partition(":")
        if colon and topic in self.topics:
            return topic, own
        raise InputError.unknown("signal", name, self.signals, where=self.where)

    def members(self, name: str) -> list[str]:
        """Return the signals of a group (`plant.eta`, `plant`), or the one of this name.

        Raises
        ------
        InputError : no such signal or group.
        """
        found = [one for one in self.signals if one == name or is_inside(one, name)]
        if not found:
            self.place(name)  # a column of a topic without a description of its signals
        return found or [name]

    def signal(
        self, name: str, *, start: Seconds | None = None, end: Seconds | None = None
    ) -> Series:
        """Read one signal over time: `plant.eta.x`, or `/link/uplink:plant.eta.x`.

        start, end : as in `read`.

        Raises
        ------
        InputError, LossError : no such signal, or a group of several, and as `read`.
        """
        members = self.members(name)
        if members != [name]:
            raise InputError(
                "a group, not a signal",
                where=self.where,
                expected=f"one of {', '.join(members[:8])}",
                got=name,
                hint=f"to_pandas({name!r}), to_arrow and to_xarray read groups",
            )
        topic, own = self.place(name)
        return series_of(self.read(topic, start=start, end=end), own)

    def __getitem__(self, name: str) -> Series:
        """Read a signal over time, or a group as one series with a column for each signal.

        Raises
        ------
        InputError, LossError : as `signal`; a group of several topics.
        """
        members = self.members(name)
        if members == [name]:
            return self.signal(name)
        places = [self.place(member) for member in members]
        topics = list(dict.fromkeys(topic for topic, _ in places))
        if len(topics) > 1:
            raise InputError(
                "a group of several topics",
                where=self.where,
                expected=f"one of {', '.join(members[:8])}, or a smaller group",
                got=name,
                hint=f"to_pandas({name!r}) puts them on a common time",
            )
        return group_of(self.read(topics[0]), name, [own for _, own in places])

    def __contains__(self, name: object) -> bool:
        return any(one == name or is_inside(one, str(name)) for one in self.signals)

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def read(
        self, topic: str, *, start: Seconds | None = None, end: Seconds | None = None
    ) -> Table:
        """Read the rows of one topic.

        start, end : least and greatest time of delivery [s]; all by default.

        Raises
        ------
        InputError : no such topic, or its encoding is neither protobuf nor JSON.
        LossError : the file is damaged, or a row does not fit its schema.
        """
        return self.read_all([topic], start=start, end=end)[topic]

    def _joined(
        self,
        what: str | Sequence[str] | None,
        align: Align,
        between: Between,
        start: Seconds | None,
        end: Seconds | None,
    ) -> tuple[Mapping[str, Sequence[Any]], Sequence[Joined]]:
        """See `Framed`."""
        if what is None:
            what = [t for t in self.topics if layout.component_of(t)] or [
                topic for topic, info in self.topics.items() if info.signals
            ]
        elif isinstance(what, str):
            if what in self.topics and isinstance(align, str) and align == "union":
                rows = self.read(what, start=start, end=end)
                return rows._joined(None, align, between, None, None)  # noqa: SLF001 - the same
            what = [what]
        wanted: list[tuple[str, str | None]] = []
        for name in what:
            if name in self.topics:
                wanted.append((name, None))
            else:
                wanted += map(self.place, self.members(name))
        needed = dict.fromkeys(topic for topic, _ in wanted)
        if isinstance(align, str) and align in self.topics:
            needed[align] = None
        tables = self.read_all(list(needed), start=start, end=end)
        return {}, [joined(self.where, wanted, self.signals, tables, align, between)]

    def plot(self, *names: str) -> Any:
        """Draw signals and groups over time, each in axes of its own; return the axes.

        names : as `[]` takes them; by default the outputs of every component.

        Raises
        ------
        InputError : as `[]`; nothing to draw, or matplotlib is not installed.
        """
        outputs = [layout.component_of(topic) for topic in self.topics if topic.endswith("/output")]
        chosen = names or tuple(name for name in outputs if name)
        if not chosen:
            raise InputError("nothing to draw", where=self.where, expected="names of signals")
        return draw_rows([self._drawn(name) for name in chosen])

    def _drawn(self, name: str) -> Series:
        """Return the series of a name; of a component that of its outputs."""
        output = layout.output_topic(name)
        if output not in self.topics:
            return self[name]
        table = self.read(output)
        numbers = [one for one in table.columns if table[one].dtype.kind != "O"]
        return group_of(table, name, numbers)

    @property
    def link_names(self) -> list[str]:
        """The names of the links, in order of appearance."""
        prefix = layout.link_topic("")
        names = [topic.removeprefix(prefix) for topic in self.topics if topic.startswith(prefix)]
        return [name for name in names if "/" not in name]

    def age(
        self, link: str, at: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return instants [s] and the age [s] of the message in use there, since its sending.

        at : instants [s]; by default just before and at each delivery, from the first one on.

        Raises
        ------
        InputError : no such link.
        """
        delivered, lost = self.delivered(link), layout.dropped_topic(link)
        metadata = self.topics[layout.link_topic(link)].metadata
        replaced = metadata.get("on_loss", "hold") != "hold" and lost in self.topics
        dropped = self.read(lost) if replaced else None
        return traffic.age_in_use(delivered, dropped, metadata, at)

    def delivered(self, link: str) -> Table:
        """Read the messages that a link delivered, at `log_time_ns`; sent at `publish_time_ns`.

        Raises
        ------
        InputError : no such link.
        """
        return self._link_rows(link, layout.link_topic(link))

    def dropped(self, link: str) -> Table:
        """Read the messages that a link dropped, with the `reason`; they were due at `log_time_ns`.

        Raises
        ------
        InputError : no such link.
        """
        return self._link_rows(link, layout.dropped_topic(link))

    def _link_rows(self, link: str, topic: str) -> Table:
        if topic not in self.topics:
            raise InputError.unknown("link", link, self.link_names, where=self.where)
        return self.read(topic)
