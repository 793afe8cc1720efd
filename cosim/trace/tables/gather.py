"""Collect the messages of one topic, chunk by chunk, in one table."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, LossError
from cosim.trace.file.declared import Channel
from cosim.trace.file.messages import Messages
from cosim.trace.file.records import LATEST_SIGNED_NS
from cosim.trace.rows.decode import RowDecoder
from cosim.trace.rows.hold import blanks
from cosim.trace.rows.json_rows import json_columns
from cosim.trace.rows.layout import Signal
from cosim.trace.tables.growing import GrowingColumn
from cosim.trace.tables.table import Table

_OTHER = {"ros1": "ROS 1", "cdr": "ROS 2 (CDR)"}
_MANY, _MANY_BYTES = 4096, 2**22
"""From so many chunks, or of so many bytes, messages are decoded together."""


def decoder_of(channel: Channel) -> RowDecoder:
    """Make the decoder of a protobuf channel; `ValueError` if its schema cannot be used."""
    return RowDecoder(channel.schema.name, channel.schema.data, channel.metadata)


class TopicRows:
    """The rows of a topic, collected from blocks of messages.

    Parameters
    ----------
    where : file and topic, for error messages.
    channels : those of the topic, by id; the columns of several are merged.
    expected : how many messages of a channel there probably are, if all are added.

    Raises
    ------
    InputError : a channel is neither protobuf nor JSON, or its schema cannot be used.
    """

    def __init__(
        self,
        where: str,
        topic: str,
        channels: Mapping[int, Channel],
        expected: Mapping[int, int],
    ) -> None:
        self.channels = channels
        self._where, self._topic = where, topic
        self._sources = {
            number: _Source(channel, where, expected.get(number, 0))
            for number, channel in channels.items()
        }
        self._heads: list[NDArray[Any]] = []
        self._rows = 0

    def __len__(self) -> int:
        return self._rows

    def add(self, messages: Messages) -> None:
        """Add messages, all of the topic.

        Raises
        ------
        LossError : a row does not fit its schema.
        InputError : the rows would not fit into the memory of this machine.
        """
        self._heads.append(messages.heads)
        _check_room(self._rows + len(messages), self._sources, self._where)
        for number, own in messages.by_channel():
            part = messages if own.size == len(messages) else messages.part(own)
            self._sources[number].add(part, self._rows + own)
        self._rows += len(messages)

    def taken(self) -> Table:
        """Return the table of all rows added, and forget them."""
        table = self.table()
        self._heads, self._rows = [], 0
        for source in self._sources.values():
            source.forget()
        return table

    def table(self) -> Table:
        """Return the table of all rows added."""
        heads = {
            key: np.concatenate([part[key] for part in self._heads] or [np.zeros(0, np.uint64)])
            for key in ("log", "publish", "sequence")
        }
        for key in ("log", "publish"):
            if heads[key].size and int(heads[key].max()) > LATEST_SIGNED_NS:
                raise _unreadable(self._where, "a time beyond 2**63 ns")
        columns: dict[str, NDArray[Any]] = {}
        present: dict[str, NDArray[np.bool_]] = {}
        signals: dict[str, Signal] = {}
        single = len(self._sources) == 1
        for source in self._sources.values():
            try:
                found, places = source.columns()
            except ValueError as error:
                raise _unreadable(self._where, str(error)) from error
            for signal, values, there in found:
                if single:
                    columns[signal.name], present[signal.name] = values, there
                else:
                    _merge(columns, present, signal.name, self._rows, places, values, there)
                signals.setdefault(signal.name, signal)
        return Table(
            topic=self._topic,
            log_time_ns=heads["log"].astype(np.int64),
            publish_time_ns=heads["publish"].astype(np.int64),
            sequence=heads["sequence"].astype(np.int64),
            columns=columns,
            present=present,
            signals=signals,
        )


def _unreadable(where: str, why: str) -> LossError:
    return LossError("the topic's rows cannot be read", where=where, got=why)


class _Source:
    """The rows of one channel."""

    def __init__(self, channel: Channel, where: str, expected: int) -> None:
        self._where, self._expected = where, expected
        self._decoder: RowDecoder | None = None
        self._columns: list[GrowingColumn] = []
        self._texts: list[Messages] = []  # of JSON
        self._places: list[NDArray[np.int64]] = []
        self._waiting: list[Messages] = []
        self._waiting_bytes = 0
        if channel.encoding == "json":
            return
        if not channel.encoding == channel.schema.encoding == "protobuf":
            name = _OTHER.get(channel.encoding, channel.encoding) or "no encoding"
            raise InputError(
                "only protobuf and JSON topics are read as columns",
                where=where,
                expected="protobuf or json",
                got=f"{name}, schema {channel.schema.name or 'without name'}",
            )
        try:
            self._decoder = decoder_of(channel)
        except ValueError as error:
            raise InputError(
                "the topic's schema is unusable", where=where, got=str(error)
            ) from error

    @property
    def width(self) -> int:
        """Number of columns; of JSON it is unknown before the rows are read, and 1."""
        return 1 if self._decoder is None else len(self._decoder.signals)

    def add(self, messages: Messages, places: NDArray[np.int64]) -> None:
        self._places.append(places)
        if self._decoder is None:
            self._texts.append(messages)
            return
        # to decode those of several chunks at once costs less
        self._waiting.append(messages.compact())
        self._waiting_bytes += len(self._waiting[-1].data)
        if self._waiting_bytes >= _MANY_BYTES or len(self._waiting) >= _MANY:
            self._decode()

    def _decode(self) -> None:
        """Decode the messages that wait."""
        if self._decoder is None or not self._waiting:
            return
        messages, self._waiting, self._waiting_bytes = Messages.joined(self._waiting), [], 0
        if not self._columns:
            dtypes = self._decoder.dtypes
            fits = 9 * self._expected * len(dtypes) <= _room()  # a damaged file may expect anything
            self._columns = [GrowingColumn(t, self._expected if fits else 0) for t in dtypes]
        try:
            found = self._decoder(messages)
        except ValueError as error:
            raise _unreadable(self._where, str(error)) from error
        for column, (values, present) in zip(self._columns, found, strict=True):
            column.extend(values, present)

    def forget(self) -> None:
        self._columns, self._texts, self._places = [], [], []
        self._waiting, self._waiting_bytes = [], 0

    def columns(
        self,
    ) -> tuple[list[tuple[Signal, NDArray[Any], NDArray[np.bool_]]], NDArray[np.int64]]:
        """Return signal, values and presence of each column; and their rows in the topic."""
        self._decode()
        places = np.concatenate(self._places) if self._places else np.zeros(0, np.int64)
        everywhere = np.ones(places.size, np.bool_)
        if self._decoder is None:
            payloads = (payload for part in self._texts for payload in part.payloads())
            signals, columns = json_columns(payloads, places.size)
            return [(s, *column) for s, column in zip(signals, columns, strict=True)], places
        grown = self._columns or [GrowingColumn(dtype, 0) for dtype in self._decoder.dtypes]
        found = []
        for signal, column in zip(self._decoder.signals, grown, strict=True):
            present = column.present
            found.append((signal, column.values, everywhere if present is None else present))
        return found, places


def _merge(
    columns: dict[str, NDArray[Any]],
    present: dict[str, NDArray[np.bool_]],
    name: str,
    rows: int,
    places: NDArray[np.int64],
    values: NDArray[Any],
    there: NDArray[np.bool_],
) -> None:
    """Merge a channel's column into the topic's; columns of different kinds become objects."""
    if name not in columns:
        columns[name] = blanks(values.dtype, rows)
        present[name] = np.zeros(rows, np.bool_)
    elif columns[name].dtype != values.dtype:
        kinds = {columns[name].dtype.kind, values.dtype.kind}
        columns[name] = columns[name].astype(
            np.float64 if kinds in ({"f", "i"}, {"f", "u"}) else object
        )
    columns[name][places] = values
    present[name][places] = there


def _check_room(rows: int, sources: Mapping[int, _Source], where: str) -> None:
    """Raise an `InputError` if the rows would need more memory than the machine has."""
    if rows * 9 * (4 + sum(source.width for source in sources.values())) > _room():
        raise InputError(
            "the topic's rows do not fit into the memory of this machine",
            where=where,
            expected=f"less than {_room() / 1e9:.3g} GB",
            got=f"more than {rows} rows",
            hint="read a part of it: start, end",
        )


def _room() -> float:
    """Return how many bytes rows may take; not known on Windows."""
    if not hasattr(os, "sysconf"):
        return math.inf
    return 0.8 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
