"""The rows of one link in a log, made into a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation

import numpy as np

from cosim.core import InputError, counted
from cosim.network import IN_FLIGHT_NS, LogFormat, Recording, Row, Unit
from cosim.recordings.log_columns import LogColumns
from cosim.recordings.lost_messages import with_due
from cosim.recordings.plausibility import Plausibility, plausibility_of

_PLACES = tuple((f"from.{axis}", f"to.{axis}") for axis in "xyz")
OPTIONAL = ("due", "node", "range", "size", *(name for pair in _PLACES for name in pair))
"""Columns that a log may have beside those that say when messages were sent and came."""

_CLOCK = Decimal(2**63 - 1).scaleb(-9)
"""Latest instant of a recorder's clock [s]: seconds since 1970 fit."""
_LOST = ("nan", "nat", "lost", "-", "inf", "null")
_MINUS_ONE = Decimal(-1)
_FLAGS = {"": False, "0": False, "false": False, "1": True, "true": True}


def seconds_text(time_ns: int) -> str:
    """Return a time in decimal seconds, to the nanosecond."""
    whole, rest = divmod(abs(time_ns), 10**9)
    return f"{'-' if time_ns < 0 else ''}{whole}.{rest:09d}"


@dataclass
class LogRows:
    """The rows of one link, one after the other.

    Attributes
    ----------
    delay : time from sending to arrival, or to when a lost message was due [ns]; None: not known.
    early : cells of arrivals before their sending; the first is an error once all are known.
    """

    columns: LogColumns
    log_format: LogFormat
    sent: list[int] = field(default_factory=list)
    delay: list[int | None] = field(default_factory=list)
    lost: list[bool] = field(default_factory=list)
    range_m: list[float] = field(default_factory=list)
    size: list[float] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    maybe_numbers: list[str] = field(default_factory=list)
    early: list[tuple[int, Row]] = field(default_factory=list)
    beyond: Row | None = None
    is_iso: bool = False

    def add(self, row: Row) -> None:
        """Add a row of a file.

        Raises
        ------
        InputError : a bad cell, or a message sent before the one above it.
        """
        columns = self.columns
        sent = self._instant(row, columns.sent)
        if self.sent and sent < self.sent[-1]:
            raise InputError(
                "the messages are not in order of sending",
                where=row.where(columns.sent),
                expected=f"{seconds_text(self.sent[-1])} s or later, as in the row before",
                got=f"{row.cells[columns.sent]}{self._unit_of(columns.sent, ' ')}",
                hint=f"sort the rows by {columns.sent}",
            )
        came = row.cells[columns.became]
        in_flight, lost = came == "in flight", columns.form != "status" and self._means_lost(row)
        if columns.status is not None:
            lost = self._flag(row, lost=lost)
        after: int | None = None
        if columns.form == "status":
            after = 0
        elif in_flight:
            after = IN_FLIGHT_NS
        elif not lost:
            after = self._after(row, columns.became, sent)
            if after < 0:
                self.early.append((after, row))
                after = 0
        elif row.cells.get("due"):
            after = self._after(row, "due", sent)
            if after < 0:
                raise _too_early(row, "due", columns)
        self.sent.append(sent)
        self.delay.append(after)
        self.lost.append(lost)
        self._add_others(row)

    def _instant(self, row: Row, column: str) -> int:
        """Return an instant of a clock [ns]: ISO 8601, or a number."""
        iso = row.iso_ns(column)
        if iso is None:
            return self._number_ns(row, column)
        self.is_iso = True
        return iso

    def _number_ns(self, row: Row, column: str) -> int:
        try:
            return row.nanoseconds(column, _CLOCK, self._unit_of(column))
        except InputError as error:
            error.hint = self._mend(row.cells[column], column)
            error.args = (error.text(),)
            raise

    def _mend(self, text: str, column: str) -> str:
        """Return what to do about a cell that is no time, or none in range."""
        with_unit = self._fitting_unit(text, self._unit_of(column))
        if with_unit is not None:
            return f"is this in {with_unit}? give {self.log_format.named(unit=with_unit)}"
        if column == self.columns.became and text:
            markers = (*(self.log_format.lost or ()), text)
            return f"if it means lost: {self.log_format.named(lost=markers)}"
        return "a time is a number, or in ISO 8601: 2024-05-01T12:00:00.25Z"

    def _unit_of(self, column: str, before: str = "") -> Unit:
        """Return the unit of numbers in a column; one that is given comes before the header's."""
        unit = self.log_format.unit or self.columns.units.get(column) or "s"
        return f"{before}{unit}"  # type: ignore[return-value]

    def _fitting_unit(self, text: str, unit: Unit) -> Unit | None:
        """Return the unit in which a number that is too large is an instant since 1970."""
        smaller: dict[Unit, tuple[Unit, ...]] = {"s": ("ms", "us", "ns"), "ms": ("us", "ns")}
        try:
            size = abs(Decimal(text)).adjusted()
        except InvalidOperation:
            return None
        digits: dict[Unit, int] = {"ms": 12, "us": 15, "ns": 18}
        return next((each for each in smaller.get(unit, ()) if size == digits[each]), None)

    def _means_lost(self, row: Row) -> bool:
        """Whether a cell in place of a time of arrival, or of a delay, means that none came."""
        text = row.cells[self.columns.became].lower()
        if not text:
            return True
        if self.log_format.lost is not None:
            return any(_same(text, each.lower()) for each in self.log_format.lost)
        if text.lstrip("+-") == "inf":
            return True
        if text in _LOST:
            return True
        # an instant of a clock may be -1; that is before the sending of all but the first ones
        if text[0] != "-" or not _same(text, "-1"):
            return False
        return self.columns.form == "delay" or self._before(row)

    def _before(self, row: Row) -> bool:
        return self._instant(row, self.columns.became) < self._instant(row, self.columns.sent)

    def _flag(self, row: Row, *, lost: bool) -> bool:
        """Return what the column of the status says, which must be what the other one says."""
        columns, text = self.columns, row.cells[self.columns.status or ""].lower()
        flag = _FLAGS.get(text)
        if self.log_format.lost is not None and flag is None:
            flag = any(_same(text, each.lower()) for each in self.log_format.lost)
        if flag is None:
            raise InputError(
                "this is neither lost nor not",
                where=row.where(columns.status or ""),
                expected="1 or true, 0 or false, or nothing",
                got=repr(row.cells[columns.status or ""]),
                hint=f"{self.log_format.named(lost=row.cells[columns.status or ''])}, if it means "
                "lost",
            )
        if columns.form != "status" and flag != lost:
            raise InputError(
                "two columns contradict each other",
                where=row.where(columns.status or ""),
                expected=f"{int(lost)}, since {columns.became} is "
                f"{row.cells[columns.became] or 'empty'}",
                got=row.cells[columns.status or ""] or "nothing",
                hint="the time at which a lost message would have come is due",
            )
        return flag

    def _after(self, row: Row, column: str, sent: int) -> int:
        """Return the time from sending to an arrival [ns], by the sender's clock."""
        offset = self.log_format.clock_offset_ns
        if column == self.columns.became and self.columns.form == "delay":
            return self._number_ns(row, column) - offset
        return self._instant(row, column) - offset - sent

    def _add_others(self, row: Row) -> None:
        cells, columns = row.cells, self.columns
        if "range" in cells:
            self.range_m.append(row.number("range", "the distance in m"))
        else:
            pairs = [pair for pair in _PLACES if all(name in cells for name in pair)]
            if pairs:
                places = [[row.number(name, "a place in m") for name in pair] for pair in pairs]
                self.range_m.append(math.hypot(*(a - b for a, b in places)))
        if "size" in cells:
            self.size.append(row.number("size", "the size of the message"))
        if columns.sequence is not None:
            self._add_number(row, columns.sequence)
        elif columns.maybe_sequence is not None:
            self.maybe_numbers.append(cells[columns.maybe_sequence])
        if row.beyond and self.beyond is None:
            self.beyond = row

    def _add_number(self, row: Row, column: str) -> None:
        text = row.cells[column]
        number = int(text) if text.isdecimal() and len(text) < 19 else None
        if number is None or (self.numbers and number <= self.numbers[-1]):
            raise InputError(
                "the sequence numbers do not increase",
                where=row.where(column),
                expected=f"more than {self.numbers[-1]}" if self.numbers else "a whole number",
                got=repr(text),
                hint="leave the sequence away where it begins anew, or counts something else",
            )
        self.numbers.append(number)

    def read(self) -> tuple[Recording, Plausibility]:
        """Return the recording, and whether it is plausible.

        Raises
        ------
        InputError : a message that came before it was sent, or rows that are out of range.
        """
        if self.early:
            raise self._came_too_early()
        begin = self.sent[0]
        sent = np.array([instant - begin for instant in self.sent], np.int64)
        recording = Recording(
            sent,
            np.array(self.lost),
            None if self.columns.form == "status" else with_due(self.delay),
            range_m=np.array(self.range_m) if self.range_m else None,
            size=np.array(self.size) if self.size else None,
            start_ns=begin,
        )
        recording = self._with_missing(recording) if self.numbers else recording
        return recording, self._plausibility(recording)

    def _with_missing(self, rows: Recording) -> Recording:
        """Return a recording with a lost message for every number that has no row.

        It was sent between those beside it, at equal distances.
        """
        numbers = np.array(self.numbers, np.int64) - self.numbers[0]
        count = int(numbers[-1]) + 1
        if count == numbers.size:
            return rows
        if count > 100 * numbers.size:
            raise InputError(
                "nearly all messages of a sequence are missing",
                where=f"column {self.columns.sequence}",
                expected="numbers that count the messages of a link",
                got=f"{counted(numbers.size, 'row')}, numbers up to {self.numbers[-1]}",
                hint="leave the sequence away, if it counts something else",
            )
        for name, column in (("range", rows.range_m), ("size", rows.size)):
            if column is not None:
                raise InputError(
                    f"messages without a row have no {name}",
                    where=f"column {name}",
                    expected=f"a row for each message, or a log without {name}",
                    got=f"{count - numbers.size} numbers without a row",
                )
        lost = np.ones(count, np.bool_)
        lost[numbers] = rows.lost
        sent = np.rint(np.interp(np.arange(count), numbers, rows.sent_ns)).astype(np.int64)
        delays: list[int | None] = [None] * count
        for place, delay in zip(numbers.tolist(), self.delay, strict=True):
            delays[place] = delay
        sent[numbers] = rows.sent_ns
        late = None if rows.delay_ns is None else with_due(delays)
        return Recording(sent, lost, late, start_ns=rows.start_ns)

    def _came_too_early(self) -> InputError:
        """Return the error for messages that came before they were sent."""
        columns, (_, first) = self.columns, self.early[0]
        error = _too_early(first, columns.became, columns)
        cells = {row.cells[columns.became] for _, row in self.early}
        least = min(after for after, _ in self.early) / 1e9
        count = counted(len(self.early), "message")
        error.got = f"{error.got}; {count} of {len(self.sent)}, by up to {-least:.4g} s"
        offset = self.log_format.clock_offset_ns / 1e9 + math.floor(least * 1e3) / 1e3
        error.hint = (
            "are both times of one clock? If the receiver's is behind by that or more: "
            f"{self.log_format.named(clock_offset=float(f'{offset:.3f}'))}"
        )
        if len(cells) == 1 and (len(self.early) > 1 or cells <= {"0", "-1"}):
            means = self.log_format.named(lost=cells.pop())
            error.hint = f"if that means lost: {means}; else: {error.hint}"
        error.args = (error.text(),)
        return error

    def _plausibility(self, recording: Recording) -> Plausibility:
        """Return what is doubtful about the rows, and about the recording made of them."""
        columns = self.columns
        unit = self._unit_of(columns.became if columns.form == "delay" else columns.sent)
        asked = list(columns.unread)
        if self.beyond is not None:
            asked.append(
                f"{self.beyond.place} has more cells than the header, which are not read: decimal "
                f"commas? write them with another delimiter"
            )
        if self._jumps():
            option = self.log_format.named(sequence=columns.maybe_sequence)
            asked.append(
                f"{columns.maybe_sequence} leaves numbers out: are these lost messages without a "
                f"row? give {option}"
            )
        is_number = not self.is_iso or columns.form == "delay"
        return plausibility_of(
            recording, self.log_format, unit=unit if is_number else None, asked=asked
        )

    def _jumps(self) -> bool:
        """Whether a column that is not read counts the messages, and leaves numbers out."""
        texts = self.maybe_numbers
        if len(texts) < 2 or not all(t.isdecimal() and len(t) < 19 for t in texts):
            return False
        steps = np.diff(np.array([int(t) for t in texts], np.int64))
        return bool((steps > 0).all() and (steps > 1).any() and (steps == 1).mean() > 0.5)


def _same(text: str, marker: str) -> bool:
    """Whether a cell is what means lost: the same text, or the same number."""
    if text == marker:
        return True
    try:
        return Decimal(text.replace(",", ".")) == Decimal(marker.replace(",", "."))
    except InvalidOperation:
        return False


def _too_early(row: Row, column: str, columns: LogColumns) -> InputError:
    is_delay = column == columns.became and columns.form == "delay"
    sent = row.cells[columns.sent]
    return InputError(
        "a message cannot arrive before it is sent",
        where=row.where(column),
        expected="0 or more" if is_delay else f"{sent} or later, when it was sent",
        got=row.cells[column],
        hint="are both times of one clock?",
    )
