"""Decode protobuf messages of one layout together.

The first message of a length is read tag by tag; the places of its tags, lengths and values are a
template. Messages with the same bytes at the places of tags and lengths have their values at the
same places, which are read as arrays. Another order of fields, other absent fields or other widths
of numbers need another template.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Path = tuple[FieldDescriptor, ...]

_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5
_WIDTHS = {_FIXED64: 8, _FIXED32: 4}
_LONGEST = 10  # bytes of a base-128 number of 64 bits
_FIXED: Mapping[int, str] = {
    FieldDescriptor.TYPE_DOUBLE: "<f8",
    FieldDescriptor.TYPE_FLOAT: "<f4",
    FieldDescriptor.TYPE_FIXED64: "<u8",
    FieldDescriptor.TYPE_SFIXED64: "<i8",
    FieldDescriptor.TYPE_FIXED32: "<u4",
    FieldDescriptor.TYPE_SFIXED32: "<i4",
}
_TEXTS = (FieldDescriptor.TYPE_STRING, FieldDescriptor.TYPE_BYTES)
_SIGNED = (FieldDescriptor.TYPE_SINT32, FieldDescriptor.TYPE_SINT64)
_NARROW = (FieldDescriptor.TYPE_INT32, FieldDescriptor.TYPE_UINT32, FieldDescriptor.TYPE_ENUM)


class _Slot(NamedTuple):
    """A value in a message: number of its leaf, first byte, number of bytes."""

    leaf: int
    at: int
    width: int


class _NotAlikeError(Exception):
    """The message needs protobuf's parser."""


@dataclass(slots=True)
class Template:
    """The places of values in messages of one layout.

    Attributes
    ----------
    slots : of the leaves that are in the message.
    defaults : leaves that are absent and read as their default (proto3 without presence).
    """

    leaves: Sequence[Path]
    row: Bytes
    slots: list[_Slot] = field(default_factory=list)
    defaults: list[int] = field(default_factory=list)
    _fixed: list[int] = field(default_factory=list)
    _more: list[int] = field(default_factory=list)
    _last: list[int] = field(default_factory=list)
    _slices: list[slice] = field(default_factory=list)

    def fits(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which messages, uint8 (m, size), have this layout."""
        alike = np.ones(len(rows), np.bool_)
        for one_layout in self._slices:
            same = rows[:, one_layout] == self.row[one_layout]
            if not same.all():  # to ask row by row costs more
                alike &= same.all(axis=1)
        for places, bit in ((self._more, 0x80), (self._last, 0)):
            if places:
                alike &= ((rows[:, places] & 0x80) == bit).all(axis=1)
        return alike

    def values(self, rows: Bytes) -> dict[int, Any]:
        """Return the values of messages that fit, by leaf; `ValueError` if a text is not UTF-8."""
        found: dict[int, Any] = {}
        for slot in self.slots:
            form = _FIXED.get(self.leaves[slot.leaf][-1].type)
            if form is not None:
                found[slot.leaf] = rows[:, slot.at : slot.at + slot.width].view(form)[:, 0]
        for slot in self.slots:
            kind = self.leaves[slot.leaf][-1].type
            if kind == FieldDescriptor.TYPE_STRING:
                texts = np.ascontiguousarray(rows[:, slot.at : slot.at + slot.width])
                found[slot.leaf] = [row.tobytes().decode() for row in texts]
            elif kind not in _FIXED:
                found[slot.leaf] = _numbers(rows[:, slot.at : slot.at + slot.width], kind)
        return found


def template(message: Descriptor, leaves: Sequence[Path], row: Bytes) -> Template | None:
    """Make the template of a message; None if it needs protobuf's parser.

    Parameters
    ----------
    leaves : the fields wanted, each with those it lies in.
    row : the message, uint8 (size,).
    """
    made = Template(leaves, row)
    reader = _Reader(made, row.tobytes())
    try:
        reader.message(message, (), 0, row.size)
    except (_NotAlikeError, IndexError):
        return None
    seen = {slot.leaf for slot in made.slots}
    for i, path in enumerate(leaves):
        if i not in seen and not path[-1].has_presence and path[:-1] in reader.messages:
            made.defaults.append(i)
    made._slices = [*_slices(made._fixed)]  # noqa: SLF001 - made here
    return made


def _slices(places: Sequence[int]) -> Iterator[slice]:
    """Yield slices that together take ascending places: tags of doubles recur at one distance."""
    left = dict.fromkeys(places)
    while left:
        first, *near = itertools.islice(left, 4)
        runs = []
        for step in [at - first for at in near] or [1]:
            stop = first
            while stop in left:
                stop += step
            runs.append(range(first, stop, step))
        run = max(runs, key=len)
        yield slice(run.start, run.stop, run.step)
        for at in run:
            del left[at]


class _Reader:
    def __init__(self, made: Template, data: bytes) -> None:
        self._made, self._data = made, data
        self._numbers = {path: i for i, path in enumerate(made.leaves)}
        self._inner = {path[:k] for path in made.leaves for k in range(1, len(path))}
        self._choices: set[Any] = set()
        self.messages: set[Path] = set()

    def message(self, kind: Descriptor, path: Path, at: int, end: int) -> None:
        """Read the fields of one message, from byte `at` to `end`."""
        if path in self.messages:  # given twice: protobuf merges the two
            raise _NotAlikeError
        self.messages.add(path)
        while at < end:
            at, key = self._length(at, end)
            found = kind.fields_by_number.get(key >> 3)
            if found is None:
                raise _NotAlikeError
            at = self._field(found, key & 7, path, at, end)
        if at != end:
            raise _NotAlikeError

    def _field(self, found: FieldDescriptor, wire: int, path: Path, at: int, end: int) -> int:
        """Read one field behind its tag, and return where the next begins."""
        choice = found.containing_oneof
        if choice is not None:
            if (path, choice.full_name) in self._choices:  # the last one counts
                raise _NotAlikeError
            self._choices.add((path, choice.full_name))
        here = (*path, found)
        leaf = None if found.is_repeated else self._numbers.get(here)
        if wire == _LENGTH:
            return self._length_field(found, here, leaf, at, end)
        if not found.is_repeated and here in self._inner:
            raise _NotAlikeError
        after = self._varint(at) if wire == _VARINT else at + _WIDTHS.get(wire, end)
        if after > end:
            raise _NotAlikeError
        if leaf is not None:
            self._slot(leaf, found, wire, at, after - at)
        return after

    def _length_field(
        self, found: FieldDescriptor, here: Path, leaf: int | None, at: int, end: int
    ) -> int:
        at, size = self._length(at, end)
        if size > end - at:
            raise _NotAlikeError
        if leaf is not None:
            self._slot(leaf, found, _LENGTH, at, size)
        elif not found.is_repeated and here in self._inner and found.message_type is not None:
            self.message(found.message_type, here, at, at + size)
        return at + size

    def _varint(self, at: int) -> int:
        while self._data[at] & 0x80:
            self._made._more.append(at)  # noqa: SLF001 - made here
            at += 1
        self._made._last.append(at)  # noqa: SLF001
        return at + 1

    def _slot(self, leaf: int, found: FieldDescriptor, wire: int, at: int, width: int) -> None:
        """Add the place of a value; it must have the wire type of its field, and occur once."""
        form = _FIXED.get(found.type)
        if found.type in _TEXTS:
            expected = _LENGTH
        elif form is None:
            expected = _VARINT
        else:
            expected = _FIXED64 if form.endswith("8") else _FIXED32
        closed = found.enum_type is not None and found.enum_type.is_closed
        again = any(slot.leaf == leaf for slot in self._made.slots)
        if wire != expected or closed or again or (wire == _VARINT and width > _LONGEST):
            raise _NotAlikeError
        self._made.slots.append(_Slot(leaf, at, width))

    def _length(self, at: int, end: int) -> tuple[int, int]:
        """Read a tag or a length, which are part of the layout."""
        value, shift = 0, 0
        while True:
            if at >= end or shift > 28:
                raise _NotAlikeError
            byte = self._data[at]
            self._made._fixed.append(at)  # noqa: SLF001 - made here
            value |= (byte & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if byte < 0x80:
                return at, value


def _numbers(rows: Bytes, kind: int) -> NDArray[Any]:
    """Decode base-128 numbers of one width, uint8 (m, width), to the values of their type."""
    value = np.zeros(len(rows), np.uint64)
    for i in range(rows.shape[1]):
        value |= (rows[:, i] & np.uint8(0x7F)).astype(np.uint64) << np.uint64(7 * i)
    if kind == FieldDescriptor.TYPE_BOOL:
        return np.not_equal(value, 0)
    if kind in _SIGNED:
        if kind == FieldDescriptor.TYPE_SINT32:
            value &= np.uint64(0xFFFFFFFF)
        half = (value >> np.uint64(1)).view(np.int64)
        return half ^ -(value & np.uint64(1)).view(np.int64)
    if kind in _NARROW:
        low = (value & np.uint64(0xFFFFFFFF)).astype(np.uint32)
        return low if kind == FieldDescriptor.TYPE_UINT32 else low.view(np.int32)
    return value if kind == FieldDescriptor.TYPE_UINT64 else value.view(np.int64)
