"""What a link is declared with: each key once, with its meaning, unit, range and default.

The dataclasses of links and of their parts annotate each field with a `Key`. From these come the
checks of the dataclasses, the keys of [links.NAME] in scenarios with their JSON schema, the
parameters of link FMUs, and the table in the documentation.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Any, NamedTuple, get_args, get_type_hints

from cosim.core import InputError
from cosim.network.checks import (
    MAX_NS,
    check_choice,
    check_duration,
    is_finite,
    is_integer,
    is_number,
)


@dataclass(frozen=True)
class Key:
    """What a key means, and which values it may have.

    Attributes
    ----------
    text : its meaning, for schemas, FMUs and documentation.
    """

    text: str

    def check(self, where: str, name: str, value: Any) -> None:
        """Raise `InputError` unless `value` is allowed; `where` + `name` is its place."""
        raise NotImplementedError


@dataclass(frozen=True)
class DurationKey(Key):
    """A time: integer nanoseconds from `least_ns` to 2**53; in scenarios and FMUs seconds."""

    least_ns: int = 0

    def check(self, where: str, name: str, value: Any) -> None:
        """Check an integer of nanoseconds in the range."""
        check_duration(where + name, value, minimum=self.least_ns)


@dataclass(frozen=True)
class ProbabilityKey(Key):
    """A number from 0 to 1; or, where the field has another type beside float, one of `instead`."""

    instead: tuple[type, ...] = ()

    def check(self, where: str, name: str, value: Any) -> None:
        """Check a number from 0 to 1."""
        if isinstance(value, self.instead):
            return
        if not is_number(value) or not 0.0 <= value <= 1.0:
            raise InputError(
                "a probability is a number from 0 to 1",
                where=where + name,
                expected="a number from 0 to 1",
                got=f"{value!r} ({type(value).__name__})",
            )


@dataclass(frozen=True)
class ProbabilitiesKey(Key):
    """Numbers from 0 to 1, one of each of `least` to `most` states; or `rows` of as many each."""

    least: int
    most: int
    rows: bool = False

    def check(self, where: str, name: str, value: Any) -> None:
        """Check the number of states and each number."""
        if not isinstance(value, tuple) or not self.least <= len(value) <= self.most:
            raise InputError(
                f"{name} has a wrong number of states",
                where=where + name,
                expected=f"{self.least} to {self.most}",
                got=str(len(value)) if isinstance(value, tuple) else repr(value),
            )
        own = ProbabilityKey(self.text)
        for i, one in enumerate(value):
            if self.rows and (not isinstance(one, tuple) or len(one) != len(value)):
                raise InputError(
                    f"{name} is not square",
                    where=f"{where}{name}[{i}]",
                    expected=f"{len(value)} numbers",
                    got=repr(one),
                )
            for j, number in enumerate(one if self.rows else [one]):
                own.check(where, f"{name}[{i}]" + f"[{j}]" * self.rows, number)


@dataclass(frozen=True)
class NumberKey(Key):
    """A finite number; with `least`, zero or from there up; with `positive`, greater than zero."""

    least: float | None = None
    positive: bool = False

    def check(self, where: str, name: str, value: Any) -> None:
        """Check a finite number in the range."""
        small = self.least is not None and value != 0
        wrong = not is_finite(value) or (self.positive and value <= 0)
        if wrong or (small and value < self.least):
            expected = "a finite number greater than 0" if self.positive else "a finite number"
            if self.least is not None:
                expected = f"0 (none), or {expected} from {self.least:g} up"
            raise InputError(
                f"{name} out of range", where=where + name, expected=expected, got=repr(value)
            )


@dataclass(frozen=True)
class CountKey(Key):
    """An integer from 0 to `most`, of `unit`; None where the field's default is None."""

    most: int = MAX_NS
    unit: str | None = None

    def check(self, where: str, name: str, value: Any) -> None:
        """Check an integer in the range."""
        if not is_integer(value) or not 0 <= value <= self.most:
            bits = self.most.bit_length()
            most = f"2**{bits - 1}" if self.most == 2 ** (bits - 1) else f"2**{bits} - 1"
            raise InputError(
                f"{name} out of range",
                where=where + name,
                expected=f"an integer from 0 to {most}",
                got=repr(value),
            )


@dataclass(frozen=True)
class ChoiceKey(Key):
    """One of some words."""

    words: tuple[str, ...]

    def check(self, where: str, name: str, value: Any) -> None:
        """Check that it is one of the words."""
        check_choice(where + name, name, value, self.words)


@dataclass(frozen=True)
class WordOrNumberKey(ChoiceKey):
    """One of some words, or a finite number."""

    def check(self, where: str, name: str, value: Any) -> None:
        """Check that it is one of the words or a finite number."""
        if value not in self.words and not is_finite(value):
            raise InputError(
                f"unknown {name}",
                where=where + name,
                expected=f"{', '.join(self.words)}, or a finite number",
                got=repr(value),
            )


@dataclass(frozen=True)
class TextKey(Key):
    """A text that is not empty; with `several`, a tuple of such texts."""

    several: bool = False

    def check(self, where: str, name: str, value: Any) -> None:
        """Check that it is such a text, or a tuple of them."""
        texts = value if self.several else (value,)
        if isinstance(texts, tuple) and all(isinstance(text, str) and text for text in texts):
            return
        raise InputError(
            f"{name} is no text",
            where=where + name,
            expected="texts that are not empty" if self.several else "a text that is not empty",
            got=repr(value),
        )


@dataclass(frozen=True)
class TableKey(Key):
    """A table of further keys, those of the dataclass `of`."""

    of: type

    def check(self, where: str, name: str, value: Any) -> None:
        """Check that it is an instance of the dataclass, whose own keys are thus in range."""
        if not isinstance(value, self.of):
            raise InputError(
                f"{name} of the wrong type",
                where=where + name,
                expected=f"a {self.of.__name__}",
                got=repr(value),
            )


class DeclaredKey(NamedTuple):
    """A key as a dataclass declares it.

    Attributes
    ----------
    field : of the dataclass: `delay_ns`, in nanoseconds.
    name : in scenarios and FMUs: `delay`, in seconds.
    default : `dataclasses.MISSING` where the key is required; None: the key may be absent.
    """

    field: str
    name: str
    key: Key
    default: Any


def keys_of(declared: type) -> dict[str, DeclaredKey]:
    """Return the keys of a link, or of a part of one, by name, in order of declaration."""
    return dict(_keys_of(declared))


@cache
def _keys_of(declared: Any) -> dict[str, DeclaredKey]:
    hints = get_type_hints(declared, include_extras=True)
    found = {}
    for field in fields(declared):
        key = next((k for k in get_args(hints[field.name])[1:] if isinstance(k, Key)), None)
        if key is not None:
            default = field.default
            if field.default_factory is not MISSING:
                default = field.default_factory()
            name = field.name.removesuffix("_ns")
            found[name] = DeclaredKey(field.name, name, key, default)
    return found


def check_keys(where: str, declared: Any) -> None:
    """Check the keys of a link, or of a part of one; `where` stands before each name.

    Raises
    ------
    InputError : a value out of its range; the message names the field.
    """
    for found in keys_of(type(declared)).values():
        value = getattr(declared, found.field)
        if value is not None or found.default is not None:
            found.key.check(where, found.field, value)
