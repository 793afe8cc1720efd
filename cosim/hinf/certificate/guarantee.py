"""What every guarantee beside gamma is: a claim, numbers that prove it, and their JSON.

A guarantee lists its numbers by the key that they have in files, each with its `Form`. From that
follow its claim, its JSON and its reader; what it adds is `failure`, the proof.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

from cosim.hinf.certificate.document import ProvedValue
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.certificate.system_parts import matrix_from_rows, number
from cosim.hinf.certificate.unknowns_json import numbers_from_json, numbers_to_json
from cosim.hinf.certificate.words import PROPERTIES
from cosim.hinf.exact import from_text, to_text

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix


@dataclass(frozen=True)
class Read:
    """For whom a value is read: the loop, the place in the file, and what was read before it."""

    system: DelaySystem
    gain: Matrix
    where: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Form:
    """How a value stands in files: what is written of it, and what reads it."""

    write: Callable[[Any], Any]
    read: Callable[[Any, Read], Any]


NUMBER = Form(to_text, lambda data, of: from_text(data, of.where))
"""A `fmpq`."""

DOUBLE = Form(float, lambda data, of: number(data, of.where))
"""A finite double."""

ROWS = Form(lambda rows: rows.tolist(), lambda data, of: matrix_from_rows(data, of.where))
"""A matrix of doubles."""


def numbers(count: Callable[[Read], int]) -> Form:
    """Return the form of a tuple of so many `fmpq`."""
    return Form(numbers_to_json, lambda data, of: numbers_from_json(data, count(of), of.where))


class Guarantee(ProvedValue):
    """A claim beside gamma with its proof.

    NAME : its key in files, and of its words.
    FORMS : its fields in the order of the file; a key "variables" is the field `proof`.
    CLAIMED : which of them are claimed.
    """

    NAME: ClassVar[str]
    FORMS: ClassVar[Mapping[str, Form]]
    CLAIMED: ClassVar[tuple[str, ...]]

    def claim(self) -> dict[str, Any]:
        """Return the claim that is proved if `failure` returns None."""
        claimed = {key: self.FORMS[key].write(getattr(self, key)) for key in self.CLAIMED}
        return {"property": PROPERTIES[self.NAME], **claimed}

    def to_json(self) -> dict[str, Any]:
        """Return the JSON values that `from_json` reads."""
        return {key: form.write(getattr(self, _field(key))) for key, form in self.FORMS.items()}

    @classmethod
    def from_json(cls, data: Any, system: DelaySystem, gain: Matrix, where: str) -> Self:
        """Read what `to_json` wrote of a loop; messages name `where`.

        Raises
        ------
        InputError : a missing key, a wrong shape, a text that is no number.
        """
        known_keys(data, where, tuple(cls.FORMS), required=tuple(cls.FORMS))
        return cls(**cls._values(data, system, gain, where))

    @classmethod
    def _values(cls, data: Any, system: DelaySystem, gain: Matrix, where: str) -> dict[str, Any]:
        """Read the fields that have a form."""
        values: dict[str, Any] = {}
        for key, form in cls.FORMS.items():
            place = Read(system, gain, f"{where}.{key}", values)
            values[_field(key)] = form.read(data[key], place)
        return values

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return why it is not proved of a loop; None if it is.

        Raises
        ------
        InputError : a proof that is too large.
        """
        raise NotImplementedError


def _field(key: str) -> str:
    return "proof" if key == "variables" else key
