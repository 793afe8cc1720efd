"""What files say of a system, as data: the matrices of Eq. (7), delays, measurements, their ages.

System files and the systems within certificates have these tables. A number is taken if it is a
double exactly; a matrix is a list of rows, and an array when it is read. Null is no value.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator

from cosim.core import Findings, InputError, KeyPath, Part, Text, format_value
from cosim.models import Delay, DelaySystem, Matrix, Measurement, Over

MATRICES = ("A", "B", "C", "D", "D1", "D2", "E", "H")
"""The matrices of a system that do not belong to one delay."""

BLOCKS = "uncertainty_blocks"
"""The key of the sizes of the blocks of F."""


def number(value: Any, where: str) -> float:
    """Read a finite double; an integer only if a double can represent it exactly.

    Raises
    ------
    InputError : anything else: text, a truth value, an infinity, a NaN.
    """
    wrong = InputError(
        "not a finite number",
        where=where,
        expected="a finite number",
        got=format_value(value),
        hint="without quotes and unit: 0.3 for 300 ms"
        if isinstance(value, str)
        else "a number, such as 0.3",
    )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong
    try:
        as_double = float(value)
    except OverflowError as error:
        raise wrong from error
    if not np.isfinite(as_double) or as_double != value:
        raise wrong
    return as_double


def matrix_from_rows(value: Any, where: str) -> Matrix:
    """Read rows of equally many finite numbers as an array with two axes."""
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        raise InputError(
            "not a matrix",
            where=where,
            expected="a list of rows, each a list of numbers, as in [[1.0, 0.0], [0.0, 1.0]]",
            got=format_value(value),
            hint="a column is [[4.0], [3.0]]",
        )
    lengths = sorted({len(row) for row in value})
    if len(lengths) > 1:
        raise InputError(
            "rows of a matrix differ in length",
            where=where,
            expected="equally many numbers in every row",
            got=f"rows of {' and '.join(map(str, lengths))}",
            hint="an entry in each place, 0.0 where there is nothing",
        )
    entries = [
        [number(x, f"{where}[{i}][{j}]") for j, x in enumerate(row)] for i, row in enumerate(value)
    ]
    return np.array(entries, dtype=np.float64).reshape(len(value), lengths[0] if lengths else 0)


def _no_null(value: Any) -> Any:
    if value is None:
        raise ValueError("a list, in brackets")
    return value


Made = TypeVar("Made")
_NUMBER = PlainValidator(partial(number, where=""), json_schema_input_type=float)
_ROWS = PlainValidator(
    partial(matrix_from_rows, where=""), json_schema_input_type=list[list[float]]
)
Double = Annotated[float, _NUMBER]
"""A finite double."""
MaybeDouble = Annotated[float | None, _NUMBER]
"""The same, or null."""
Seconds = Annotated[float, _NUMBER, Field(ge=0)]
"""A time that is not negative [s]."""
Numbers = Annotated[tuple[Double, ...], Field(strict=False)]  # from a list
"""Finite doubles."""
Rows = Annotated[Matrix, _ROWS]
"""A matrix, as rows of finite doubles."""
MaybeRows = Annotated[Matrix | None, _ROWS]
"""The same, or null."""
Truths = list[bool] | list[list[bool]]
"""One truth value per state, or one such list per control."""
Pair = Annotated[list[int], Field(min_length=2, max_length=2)]


class AgePart(Part):
    """A delay, or the age of a measurement, and what is known of it."""

    d: Seconds = 0.0
    """The delay, or the greatest age at the end of its use [s]; 0: at once."""
    any_age: bool = False
    """Every age from 0 to d, however it varies, in place of the constant d. Feedback that is held
    between messages or steps has no constant age.
    """
    least_age: Double = 0.0
    """The age is never less than this [s]."""
    rate: MaybeDouble = None
    """The age is continuous, and changes no faster than this."""
    sampled: bool = False
    """The age is least_age when a sample comes into use, grows at rate one, and is at most d when
    the next one does.
    """

    def known_of_age(self) -> dict[str, Any]:
        """Return what is known of the age, as `Delay` and `Measurement` take it."""
        return self.model_dump(include={"least_age", "rate", "sampled"})


class DelayPart(AgePart):
    """[[system.delays]]: one delay, with what is known of its age."""

    d: Seconds
    """The delay, or the greatest age [s]."""
    A: MaybeRows = None
    """Of x(t-d), n rows and columns; without it zero."""
    H: MaybeRows = None
    """Right factor of the uncertainty of this A, n columns."""
    feedback: bool | Truths = False
    """The control acts through this delay, u = K x(t-d): true, or one truth value for each state,
    or a list of these for each control.
    """

    def delay(self, n: int) -> Delay:
        """Return the term of a system of n states; `InputError` where its parts do not fit."""
        A = np.zeros((n, n)) if self.A is None else self.A
        return fitted(Delay, self.d, A, self.H, self.feedback, self.any_age, **self.known_of_age())


_WRITTEN = {
    BLOCKS: "pairs, columns of E and rows of H of each block: two parameters are [[1, 1], [1, 1]]",
    "feedback": "one truth value per state, [true, false], or one such list per control",
    "sampled": "the longest interval between two samples is d - least_age",
}
"""How the values of some keys are written."""


class SystemPart(Part):
    """The matrices of Eq. (7); a matrix is a list of rows."""

    name: str = ""
    """Name of the system; without it that of the file."""
    A: Rows
    """Of x(t), n rows and columns."""
    B: MaybeRows = None
    """Of the control u, n rows."""
    C: MaybeRows = None
    """Of the disturbance w, n rows."""
    D: MaybeRows = None
    """z = D x + D1 w + D2 u, what is to be kept small; n columns."""
    D1: MaybeRows = None
    """Of w in z, as many rows as D."""
    D2: MaybeRows = None
    """Of u in z, as many rows as D."""
    E: MaybeRows = None
    """Left factor of the uncertainty E F(t) [H, H1], F'F <= I; n rows."""
    H: MaybeRows = None
    """Right factor of the uncertainty of A, n columns."""
    delays: list[DelayPart] = Field(default_factory=list)
    """Any number of delays, [[system.delays]]."""
    uncertainty_blocks: Annotated[list[Pair] | None, BeforeValidator(_no_null)] = None
    """Columns of E and rows of H of each block of F; [1, 1] is a parameter."""
    feedback: Truths | None = None
    """One truth value for each state: whether it is fed back at once. Without it every state is,
    unless a delay is marked feedback; a state that is fed back nowhere is not measured.
    """

    @classmethod
    def advice(cls, wrong: str, path: KeyPath, value: Any, data: Any) -> str | None:  # noqa: ARG003 - as `Part` has them
        """Return how values of lists and of truth values are written."""
        words = [part for part in path if isinstance(part, str)]
        return None if wrong == "extra_forbidden" or not words else _WRITTEN.get(words[-1])

    def system(self, delays: list[Delay], name: str = "", **more: Any) -> DelaySystem:
        """Return the system with these delays; `name` unless the table has one.

        Raises
        ------
        InputError : parts that do not fit together.
        """
        matrices = {key: getattr(self, key) for key in MATRICES}
        kinds = {"feedback": self.feedback, BLOCKS: self.uncertainty_blocks}
        name = self.name if "name" in self.model_fields_set else name
        return fitted(DelaySystem, **matrices, **kinds, delays=delays, name=name, **more)

    def terms(self, findings: Findings, place: KeyPath = ()) -> list[Delay]:
        """Return the delays; those that do not fit are located below `place` of the file."""
        terms = []
        for i, delay in enumerate(self.delays):
            with findings.at(*place, "delays", i):
                terms.append(delay.delay(len(self.A)))
        return terms


class MeasurementPart(AgePart):
    """A sensor: its name, how old and how noisy it is, and how it reaches the observer."""

    name: Text
    """Name of the sensor."""
    noise: Double | Numbers = 0.0
    """Size of v, one for each row; weighed in like w."""
    over: Over = "link"
    """How it reaches the observer."""

    def measurement(self, C: Matrix, *, any_age: bool) -> Measurement:
        """Return the measurement of C x; `InputError` where its parts do not fit."""
        noise = self.noise if isinstance(self.noise, tuple) else [self.noise] * len(C)
        kinds = {"any_age": any_age, "noise": noise, "over": self.over}
        return fitted(Measurement, self.name, C, self.d, **kinds, **self.known_of_age())


def counted_as(
    values: tuple[float, ...] | None, count: int, where: str, what: str
) -> tuple[float, ...] | None:
    """Return `values`, where they are `count` or absent.

    Raises
    ------
    InputError : "not one number per `what`".
    """
    if values is None or len(values) == count:
        return values
    raise InputError(
        f"not one number per {what}",
        where=where,
        expected=f"a list of {count}",
        got=f"{len(values)} of them",
    )


def fitted(make: Callable[..., Made], *parts: Any, **more: Any) -> Made:
    """Return what `make` makes of parts of a file.

    Raises
    ------
    InputError : they do not fit together: the ValueError of `make`, what it says apart.
    """
    try:
        return make(*parts, **more)
    except ValueError as error:
        shapes = _SHAPE.fullmatch(str(error))
        if shapes is None:
            raise InputError(str(error)) from error
        what, expected, got = shapes.groups()
        hint = _SHAPES.get(what[0])
        raise InputError(what, expected=expected, got=got, hint=hint) from error


_SHAPE = re.compile(r"(.*: wrong shape); expected (.*), got (.*)")
_BY_STATE = "one row per state: a column is [[4.0], [3.0]]"
_SHAPES = {
    "A": "one row and one column per state",
    "B": _BY_STATE,
    "C": _BY_STATE,
    "D": "one column per state: a row is [[4.0, 3.0]]",
    "E": _BY_STATE,
    "H": "one column per state: a row is [[4.0, 3.0]]",
}
