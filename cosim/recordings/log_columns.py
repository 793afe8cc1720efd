"""Which column of a log says what: as a format names them, or by their usual names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from cosim.core import AnyPath, InputError, nearest
from cosim.network import Delimiter, Header, LogFormat, Unit, read_header

Role = Literal["sent", "received", "delay", "status", "sequence"]
Form = Literal["received", "delay", "status"]
"""What became of messages is said by an instant of arrival, a delay, or lost or not alone."""

_PLAIN: dict[Role, str] = {
    "sent": "sent",
    "received": "delivered",
    "delay": "delay",
    "status": "lost",
}
"""Names that mean one thing whatever is beside them."""
_VERBS: dict[Role, frozenset[str]] = {
    "sent": frozenset(
        ("sent", "send", "sending", "tx", "transmit", "transmitted", "transmission", "transmitter")
    ),
    "received": frozenset(
        (
            *("received", "receive", "recv", "receiving", "reception", "receiver", "rx"),
            *("delivered", "delivery", "arrival", "arrive"),
        )
    ),
    "delay": frozenset(("delay",)),
    "status": frozenset(("lost",)),
}
_OF_TIME = frozenset(
    ("t", "ts", "time", "times", "timestamp", "stamp", "at", "of", "epoch", "utc", "date", "unix")
)
"""Words beside one of `_VERBS` in the name of a column of times; alone they say nothing."""
_MAYBE_DELAY = frozenset(
    ("latency", "rtt", "rtd", "owtt", "owd", "lag", "travel", "flight", "tof", "roundtrip", "trip")
)
"""Words for times that may be a delay, or the time there and back."""
_NUMBERING = frozenset(("seq", "sequence", "seqno", "seqnum", "id", "msgid", "counter", "number"))
_BESIDE_NUMBERING = frozenset(("no", "nr", "msg", "message", "packet", "pkt", "frame", "ping"))
_UNITS: dict[str, Unit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "\u00b5s", "\u03bcs", "usec", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), "ns"),
}
_WITH_UNIT = re.compile(rf"(.+?)[\s_.\[(/]+({'|'.join(_UNITS)})[\])]?", re.IGNORECASE)
_MOST = 200


@dataclass(frozen=True)
class LogColumns:
    """The columns of a log, by what they say.

    Attributes
    ----------
    delimiter : of the file.
    sent : name of the column of the times of sending.
    form, became : what says what became of a message, and the name of that column.
    status, sequence : names of columns, or None.
    units : unit of times that are numbers, by column; of those whose header says one.
    unread : remarks on columns that are not read, and could say something.
    maybe_sequence : a column that is not read, and may have the sequence numbers.
    """

    delimiter: Delimiter
    sent: str
    form: Form
    became: str
    status: str | None
    sequence: str | None
    units: dict[str, Unit]
    unread: tuple[str, ...]
    maybe_sequence: str | None

    @property
    def required(self) -> tuple[str, ...]:
        """The columns that are read, each once."""
        names = (self.sent, self.became, self.status, self.sequence)
        return tuple(dict.fromkeys(name for name in names if name is not None))


def log_columns(path: AnyPath, log_format: LogFormat) -> LogColumns:
    """Find the columns of a log.

    Raises
    ------
    InputError : a file that cannot be read, a column that is not there or there twice, or none or
        several that may be meant; shows the header and says how to name one.
    """
    wanted = {name for role in _VERBS if (name := getattr(log_format, role)) is not None}

    def fitness(names: list[str]) -> float:
        if {"sent"} < {*names} & {*_PLAIN.values()}:
            return len(names) + 1.0  # as files of this project are written, whatever else is there
        return sum(name in wanted or role_of(name) is not None for name in names)

    header = read_header(path, fitness, log_format.delimiter)
    return _Search(path, header, log_format).columns()


def role_of(name: str) -> Role | None:
    """Return what a column with this name says by its usual meaning; None where that is open."""
    words = [] if re.search("[,;\t]", name) else [*_words(name)]
    if not {*words} - _NUMBERING - _BESIDE_NUMBERING and {*words} & _NUMBERING:
        return "sequence"
    rest = [word for word in words if word not in _OF_TIME]
    if len(rest) != 1 or (rest == ["lost"] and len(words) > 1):
        return None
    return next((role for role, verbs in _VERBS.items() if rest[0] in verbs), None)


def unit_in_name(name: str) -> Unit | None:
    """Return the unit that the name of a column ends with, as `tx_ms`, `sent [us]`; or None."""
    found = _WITH_UNIT.fullmatch(name)
    return None if found is None else _UNITS[found[2].lower()]


def _words(name: str) -> Sequence[str]:
    """Return the words of the name of a column, without a unit, in small letters."""
    found = _WITH_UNIT.fullmatch(name)
    stem = name if found is None else found[1]
    return [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", stem)]


class _Search:
    """The search for the columns of one file."""

    def __init__(self, path: AnyPath, header: Header, log_format: LogFormat) -> None:
        self._path, self._format, self._delimiter = path, log_format, header.delimiter
        self._where = f"{path}, {header.place}"
        self._names = header.names
        self._roles = {name: role_of(name) for name in header.names}

    def columns(self) -> LogColumns:
        """Return the columns."""
        names = self._names
        if not names:
            raise InputError("the file is empty", where=self._where, expected="a column 'sent'")
        if all(re.fullmatch(r"[-+\d.,:TZe]*", name) for name in names):
            raise self._error(
                "the first line has no names of columns",
                "a header, then a line for each message",
                'write one above it, as "sent,received"; a # begins a comment',
            )
        sent = self._named("sent") or self._usual("sent")
        if sent is None:
            raise self._unknown("when messages were sent", "sent")
        form, became = self._form(sent)
        status = self._named("status") or self._usual("status")
        sequence = self._named("sequence")
        times = {sent, became} if form != "status" else {sent}
        if form == "status" and self._format.clock_offset_ns:
            raise self._error(
                "there are no times of arrival from which to subtract an offset",
                "a column of times of arrival, or of delays",
                self._format.named(received="NAME"),
            )
        return LogColumns(
            self._delimiter,
            sent,
            form,
            became,
            status,
            sequence,
            {name: unit for name in times if (unit := unit_in_name(name)) is not None},
            tuple(self._unread(form)),
            None if sequence is not None else self._only("sequence"),
        )

    def _form(self, sent: str) -> tuple[Form, str]:
        """Return what says what became of the messages, and the name of its column."""
        forms: tuple[Form, ...] = ("received", "delay", "status")
        given = [(form, name) for form in forms if (name := self._named(form)) is not None]
        if given:
            return self._beside_status(given)
        if sent == "sent":  # as files of this project are written, whatever else is there
            plain = [(form, _PLAIN[form]) for form in forms if _PLAIN[form] in self._names]
            if plain:
                self._once(plain[0][1])
                return plain[0]
        for form in forms:
            name = self._usual(form)
            if name is not None:
                return form, name
            asked = [name for name in self._names if {*_words(name)} & _MAYBE_DELAY]
            if form == "delay" and asked:
                raise self._error(
                    f"{asked[0]} may be the delay of a message, or the time there and back",
                    "a column of times of arrival, or of delays one way",
                    f"{self._format.named(delay=asked[0])}, if it is from sending to arrival; "
                    "half of it, if it is there and back",
                )
        raise self._unknown("what became of the messages", "received")

    def _beside_status(self, given: list[tuple[Form, str]]) -> tuple[Form, str]:
        """Return the form that a format names; beside a status, times of arrival are read."""
        beside: tuple[Form, ...] = ("received", "delay") if given[0][0] == "status" else ()
        found = ((form, self._usual(form)) for form in beside)
        return next(((form, name) for form, name in found if name is not None), given[0])

    def _named(self, role: Role) -> str | None:
        """Return the column that the format names for this; None where it names none."""
        name: str | None = getattr(self._format, role)
        if name is None:
            return None
        if name not in self._names:
            names = nearest(name, self._names) or self._names[:1]
            raise self._error(
                f"there is no column {name!r}",
                f"the name of a column as {role}",
                f"{self._format.named(**{role: (self._only(role) or names[0])})}",
            )
        return self._once(name)

    def _once(self, name: str) -> str:
        if self._names.count(name) > 1:
            raise InputError(
                f"there are several columns {name!r}", where=self._where, expected="one"
            )
        return name

    def _only(self, role: Role) -> str | None:
        """Return the one column that usually says this; None where none does, or several do."""
        names = [name for name in self._names if self._roles[name] == role]
        return names[0] if len(names) == 1 else None

    def _usual(self, role: Role) -> str | None:
        """Return the column that says this by its usual name; None where none does."""
        plain = _PLAIN[role]
        if plain in self._names:
            return self._once(plain)
        names = [name for name in self._names if self._roles[name] == role]
        if len(names) > 1:
            options = " or ".join(self._format.named(**{role: name}) for name in names[:3])
            raise self._error(f"several columns may be {role}: {', '.join(names)}", "one", options)
        return names[0] if names else None

    def _unread(self, form: Form) -> list[str]:
        """Return remarks on columns that are not read although their names say something."""
        name = self._only("received")
        if form != "status" or name is None:
            return []
        option = self._format.named(received=name)
        return [f"no times of arrival are read: is {name} one? give {option}"]

    def _unknown(self, what: str, role: Role) -> InputError:
        of_time = [n for n in self._names if self._roles[n] is None and {*_words(n)} & _OF_TIME]
        name = of_time[0] if len(of_time) == 1 else "NAME"
        usual = {
            "sent": "a column sent, or one such as tx, send_time",
            "received": "a column delivered (empty where lost), or one such as rx, arrival; or "
            "delay; or lost (0 or 1)",
        }
        hint = f"{self._format.named(**{role: name})} names it"
        if len(self._names) == 1 and self._format.delimiter is not None:
            hint = f"leave the delimiter away, so that it is found; else {hint}"
        return self._error(f"no column says {what}", usual[role], hint)

    def _error(self, what: str, expected: str, hint: str) -> InputError:
        got = f"the header: {self._header()}"
        return InputError(what, where=self._where, expected=expected, got=got, hint=hint)

    def _header(self) -> str:
        between = {"tab": "  ", "space": " "}.get(self._delimiter, self._delimiter)
        line = between.join(self._names)
        return line if len(line) <= _MOST else f"{line[:_MOST]}..."
