"""Protobuf rows of one topic to NumPy columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError

from cosim.trace.encode import tag
from cosim.trace.layout import message_class, signal_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from google.protobuf.descriptor import Descriptor
    from numpy.typing import NDArray

    from cosim.trace.layout import Kind, Signal

_KINDS: Mapping[int, Kind] = {
    FieldDescriptor.CPPTYPE_DOUBLE: "float",
    FieldDescriptor.CPPTYPE_FLOAT: "float",
    FieldDescriptor.CPPTYPE_INT32: "int",
    FieldDescriptor.CPPTYPE_INT64: "int",
    FieldDescriptor.CPPTYPE_UINT32: "int",
    FieldDescriptor.CPPTYPE_ENUM: "int",
    FieldDescriptor.CPPTYPE_BOOL: "bool",
    FieldDescriptor.CPPTYPE_STRING: "string",
}
"""What becomes a column; repeated fields, bytes and uint64 do not."""

_ABSENT: Mapping[Kind, Any] = {"float": np.nan, "int": 0, "bool": False, "string": ""}
_DTYPES: Mapping[Kind, Any] = {
    "float": np.float64,
    "int": np.int64,
    "bool": np.bool_,
    "string": object,
}

MAX_DEPTH = 8
"""Messages nested deeper are left out (a message may contain itself)."""


class _Leaf(NamedTuple):
    path: tuple[FieldDescriptor, ...]
    kind: Kind


class RowDecoder:
    """Decodes the rows of one schema.

    Parameters
    ----------
    schema_name, schema_data : of the MCAP schema record (a FileDescriptorSet).
    metadata : of the channel; gives the columns their FMI names.

    Raises
    ------
    ValueError : the schema does not describe `schema_name`.
    """

    def __init__(self, schema_name: str, schema_data: bytes, metadata: Mapping[str, str]) -> None:
        try:
            files = FileDescriptorSet.FromString(schema_data)
            self._message = message_class(_in_order(files), schema_name)
        except (DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
            raise ValueError(f"schema {schema_name!r} cannot be used: {error}") from error
        self._leaves = list(_leaves(self._message.DESCRIPTOR, ()))
        self.signals = _signals(self._leaves, metadata)

    def __call__(
        self, payloads: Sequence[bytes | memoryview]
    ) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[np.bool_]]]:
        """Columns by signal name, and where each has a value (NaN, 0, False, "" elsewhere).

        Raises
        ------
        ValueError : a row is not a message of the schema.
        """
        names = [signal.name for signal in self.signals]
        fast = self._fixed_stride(payloads)
        if fast is not None:
            everywhere = np.ones(len(payloads), np.bool_)
            return dict(zip(names, fast, strict=True)), dict.fromkeys(names, everywhere)
        columns: list[list[Any]] = [[] for _ in names]
        for k, payload in enumerate(payloads):
            try:
                message = self._message.FromString(bytes(payload))
            except DecodeError as error:
                raise ValueError(f"row {k} does not fit its schema: {error}") from error
            for column, leaf in zip(columns, self._leaves, strict=True):
                column.append(_value(message, leaf))
        values, present = {}, {}
        for name, leaf, column in zip(names, self._leaves, columns, strict=True):
            filled = [_ABSENT[leaf.kind] if value is None else value for value in column]
            values[name] = np.array(filled, dtype=_DTYPES[leaf.kind])
            present[name] = np.array([value is not None for value in column], dtype=np.bool_)
        return values, present

    def _fixed_stride(
        self, payloads: Sequence[bytes | memoryview]
    ) -> list[NDArray[np.float64]] | None:
        """Columns, if every row is tag, double, tag, double, ... in field order; else None."""
        fields = [leaf.path[0] for leaf in self._leaves]
        double = FieldDescriptor.TYPE_DOUBLE
        if not payloads or not fields or any(field.type != double for field in fields):
            return None
        if len(fields) != len(self._message.DESCRIPTOR.fields):
            return None
        tags = [tag(field.number) for field in fields]
        layout: list[Any] = []
        for i, expected in enumerate(tags):
            layout += [(f"tag{i}", np.uint8, (len(expected),)), (f"value{i}", "<f8")]
        dtype = np.dtype(layout)
        if any(len(payload) != dtype.itemsize for payload in payloads):
            return None
        rows = np.frombuffer(b"".join(payloads), dtype=dtype)
        for i, expected in enumerate(tags):
            if (rows[f"tag{i}"] != np.frombuffer(expected, np.uint8)).any():
                return None
        return [rows[f"value{i}"].astype(np.float64) for i in range(len(tags))]


def _in_order(files: FileDescriptorSet) -> FileDescriptorSet:
    """Files sorted so that each comes after those it depends on; duplicates are an error."""
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
    """Message types on the way down, so that a message inside itself ends there."""
    return {field.containing_type for field in path} | {field.message_type for field in path}


def _signals(leaves: Sequence[_Leaf], metadata: Mapping[str, str]) -> tuple[Signal, ...]:
    signals = []
    for leaf in leaves:
        dotted = ".".join(field.name for field in leaf.path)
        signals.append(signal_of(dotted, leaf.kind, metadata))
    if len({signal.name for signal in signals}) < len(signals):  # metadata that names two alike
        signals = [
            signal_of(".".join(field.name for field in leaf.path), leaf.kind, {}) for leaf in leaves
        ]
    return tuple(signals)


def _value(message: Any, leaf: _Leaf) -> Any:
    for field in leaf.path:
        if field.has_presence and not message.HasField(field.name):
            return None
        message = getattr(message, field.name)
    return message
