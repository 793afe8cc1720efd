"""Decode the protobuf rows of one topic to NumPy columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from cosim.core import distinct
from cosim.trace.file.messages import Messages
from cosim.trace.rows.hold import blanks
from cosim.trace.rows.layout import DTYPES, Kind, Signal, message_class, signal_of
from cosim.trace.rows.template import Template, template

Column = tuple[NDArray[Any], NDArray[np.bool_] | None]

_KINDS: Mapping[int, Kind] = {
    FieldDescriptor.CPPTYPE_DOUBLE: "float",
    FieldDescriptor.CPPTYPE_FLOAT: "float",
    FieldDescriptor.CPPTYPE_INT32: "int",
    FieldDescriptor.CPPTYPE_INT64: "int",
    FieldDescriptor.CPPTYPE_UINT32: "int",
    FieldDescriptor.CPPTYPE_UINT64: "uint",
    FieldDescriptor.CPPTYPE_ENUM: "int",
    FieldDescriptor.CPPTYPE_BOOL: "bool",
    FieldDescriptor.CPPTYPE_STRING: "string",
}
"""Types that become a column; repeated fields and bytes do not."""

MAX_DEPTH = 8
"""Messages nested deeper are left out (a message may contain itself)."""

_LAYOUTS = 8
"""Most layouts of one length; rows of others are parsed by protobuf."""
_WORTH = 16
"""Least average number of rows per length for decoding rows of one length together."""


class _Leaf(NamedTuple):
    path: tuple[FieldDescriptor, ...]
    kind: Kind


class RowDecoder:
    """A decoder of the rows of one schema.

    Parameters
    ----------
    schema_name, schema_data : of the MCAP schema record (a FileDescriptorSet).
    metadata : of the channel; with the FMI names of the columns.

    Attributes
    ----------
    message : protobuf's class of the rows.
    signals, dtypes : of the columns.

    Raises
    ------
    ValueError : the schema does not describe `schema_name`.
    """

    def __init__(self, schema_name: str, schema_data: bytes, metadata: Mapping[str, str]) -> None:
        try:
            files = FileDescriptorSet.FromString(schema_data)
            self.message = message_class(_in_order(files), schema_name)
        except (DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
            raise ValueError(f"schema {schema_name!r} cannot be used: {error}") from error
        self._leaves = list(_leaves(self.message.DESCRIPTOR, ()))
        self._paths = [leaf.path for leaf in self._leaves]
        self._known: dict[int, Template] = {}
        self.signals = _signals(self._leaves, metadata)
        self.dtypes = [DTYPES[leaf.kind] for leaf in self._leaves]

    def __call__(self, messages: Messages) -> list[Column]:
        """Return a column per signal: values, and where they are present (None: everywhere).

        The values may be of a narrower type than in `dtypes`, and lie in the buffer of the
        messages. An absent value is NaN, 0, False or "". `ValueError` if a message does not fit the
        schema.
        """
        parts = list(messages.by_size()) if _few(messages.sizes) else []
        if len(parts) == 1:
            made = self._template(parts[0][1])
            if made is not None and made.fits(parts[0][1]).all():
                return self._alike(made, parts[0][1])
        count = len(messages)
        columns = [(blanks(d, count), np.zeros(count, np.bool_)) for d in self.dtypes]
        if not parts and len(messages):
            self._parsed(messages, np.arange(len(messages)), columns)
        for which, rows in parts:
            self._fill(messages, which, rows, columns)
        return [(values, None if present.all() else present) for values, present in columns]

    def _template(self, rows: NDArray[np.uint8]) -> Template | None:
        """Return the layout of the first row: the last one of this length, if that fits."""
        known = self._known.get(rows.shape[1])
        if known is not None and known.fits(rows[:1])[0]:
            return known
        made = template(self.message.DESCRIPTOR, self._paths, rows[0])
        if made is not None:
            self._known[rows.shape[1]] = made
        return made

    def _alike(self, made: Template, rows: NDArray[np.uint8]) -> list[Column]:
        """Return the columns of rows that all have one layout."""
        values = made.values(rows)
        columns: list[Column] = []
        for i, (leaf, dtype) in enumerate(zip(self._leaves, self.dtypes, strict=True)):
            if i in values:
                found = values[i]  # texts are a list
                columns.append(
                    (found if isinstance(found, np.ndarray) else np.array(found, dtype), None)
                )
            elif i in made.defaults:
                columns.append((np.full(len(rows), leaf.path[-1].default_value, dtype), None))
            else:
                columns.append((blanks(dtype, len(rows)), np.zeros(len(rows), np.bool_)))
        return columns

    def _fill(
        self,
        messages: Messages,
        which: NDArray[np.int64],
        rows: NDArray[np.uint8],
        columns: Sequence[tuple[NDArray[Any], NDArray[np.bool_]]],
    ) -> None:
        """Decode rows of one length, layout by layout, and the rest by protobuf's parser."""
        left = np.arange(which.size)
        for _ in range(_LAYOUTS):
            made = self._template(rows[left]) if left.size else None
            if made is None:
                break
            alike = made.fits(rows[left])
            mine = left[alike]
            for i, values in made.values(rows[mine]).items():
                columns[i][0][which[mine]] = values
                columns[i][1][which[mine]] = True
            for i in made.defaults:
                columns[i][0][which[mine]] = self._leaves[i].path[-1].default_value
                columns[i][1][which[mine]] = True
            left = left[~alike]
        self._parsed(messages, which[left], columns)

    def _parsed(
        self,
        messages: Messages,
        which: NDArray[np.int64],
        columns: Sequence[tuple[NDArray[Any], NDArray[np.bool_]]],
    ) -> None:
        """Decode rows by protobuf's own parser."""
        for k, payload in zip(which, messages.part(which).payloads(), strict=True):
            try:
                message = self.message.FromString(bytes(payload))
            except DecodeError as error:
                raise ValueError(f"a row does not fit its schema: {error}") from error
            for (values, present), leaf in zip(columns, self._leaves, strict=True):
                value = _value(message, leaf)
                if value is not None:
                    values[k], present[k] = value, True


def _few(sizes: NDArray[np.int64]) -> bool:
    """Whether there are so few lengths that rows of one length are decoded together."""
    if sizes.size and (sizes == sizes[0]).all():
        return True
    return bool(distinct(sizes).size <= max(1, sizes.size // _WORTH))


def _in_order(files: FileDescriptorSet) -> FileDescriptorSet:
    """Sort files so that each comes after those it depends on; `ValueError` for duplicates."""
    waiting = {file.name: file for file in files.file}
    if len(waiting) < len(files.file):
        raise ValueError("a file appears twice")
    result = FileDescriptorSet()
    while waiting:
        ready = [f for f in waiting.values() if not any(d in waiting for d in f.dependency)]
        if not ready:
            raise ValueError("files depend on each other in a circle")
        for file in ready:
            result.file.append(file)
            del waiting[file.name]
    return result


def _leaves(message: Descriptor, path: tuple[FieldDescriptor, ...]) -> Iterator[_Leaf]:
    for field in message.fields:
        if field.is_repeated:
            continue
        if field.message_type is not None:
            if len(path) < MAX_DEPTH and field.message_type not in _types(path):
                yield from _leaves(field.message_type, (*path, field))
        elif field.cpp_type in _KINDS and field.type != FieldDescriptor.TYPE_BYTES:
            yield _Leaf((*path, field), _KINDS[field.cpp_type])


def _types(path: tuple[FieldDescriptor, ...]) -> set[Any]:
    """Return the message types along a path, to stop where a message contains itself."""
    return {field.containing_type for field in path} | {field.message_type for field in path}


def _signals(leaves: Sequence[_Leaf], metadata: Mapping[str, str]) -> tuple[Signal, ...]:
    names = [".".join(field.name for field in leaf.path) for leaf in leaves]
    signals = [signal_of(n, leaf.kind, metadata) for n, leaf in zip(names, leaves, strict=True)]
    if len({signal.name for signal in signals}) < len(signals):  # metadata repeat a name
        signals = [signal_of(n, leaf.kind, {}) for n, leaf in zip(names, leaves, strict=True)]
    return tuple(signals)


def _value(message: Any, leaf: _Leaf) -> Any:
    for field in leaf.path:
        if field.has_presence and not message.HasField(field.name):
            return None
        message = getattr(message, field.name)
    return message
