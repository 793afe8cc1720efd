"""Parse values with units: `"50 ms"`, `"2 kN"`, `"20 deg"`, `"3 kn"`.

A quantity is a number and a unit; units are the names in `units.txt`, with `*`, `/`, `^` and FMI's
notation of powers (`m/s2`). Angles are a dimension of their own: 1 Hz is not 1 rad/s.
"""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from cosim.core.errors import InputError

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad", "bit")
# the lookaheads read a number whole: "1e6" must not become 1 e^6, nor "51/s" become 5 1/s
NUMBER = r"[-+]?(?:\d+(?:_\d+)*\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3}(?!\d)|(?!\d|[eE][-+]?\d))"
"""A number, as a regular expression."""
_NAME = r"(?:[A-Za-zµμΩ°]+|%)"
_FACTOR = rf"{_NAME}(?:(?:\^|\*\*)?-?\d)?"
UNIT = rf"(?:1/)?{_FACTOR}(?:[*/.·]{_FACTOR})*"
"""A unit, as a regular expression."""
_QUANTITY = re.compile(rf"\s*({NUMBER})\s*({UNIT})\s*")
_FACTORS = re.compile(rf"([*/.·]?)({_NAME})(?:(?:\^|\*\*)?(-?\d))?")
_POWER = re.compile(r"([A-Za-z]+)(-?\d+(?:/\d+)?)?")
_LONGEST = 60


class Dimension(NamedTuple):
    """Exponents of the SI base units, of the radian and of the bit."""

    exponents: tuple[Fraction, ...]

    def __mul__(self, other: object) -> Dimension:
        if not isinstance(other, Dimension):
            return NotImplemented
        pairs = zip(self.exponents, other.exponents, strict=True)
        return Dimension(tuple(a + b for a, b in pairs))

    def power(self, exponent: Fraction) -> Dimension:
        """Return the dimension of a power."""
        return Dimension(tuple(a * exponent for a in self.exponents))

    @property
    def angle(self) -> Fraction:
        """Exponent of the radian."""
        return self.exponents[_BASES.index("rad")]

    def without_angle(self) -> Dimension:
        """Return the dimension with radians as plain numbers."""
        place = _BASES.index("rad")
        return Dimension((*self.exponents[:place], Fraction(0), *self.exponents[place + 1 :]))

    def __str__(self) -> str:
        up = [_written(b, e) for b, e in zip(_BASES, self.exponents, strict=True) if e > 0]
        down = [_written(b, -e) for b, e in zip(_BASES, self.exponents, strict=True) if e < 0]
        if not up and not down:
            return "a number without unit"
        return "/".join(["*".join(up) or "1", *down])


def _written(base: str, exponent: Fraction) -> str:
    return base if exponent == 1 else f"{base}^{exponent}"


def dimension(**exponents: int) -> Dimension:
    """Make a dimension from exponents of base units: dimension(m=1, s=-2)."""
    return Dimension(tuple(Fraction(exponents.get(base, 0)) for base in _BASES))


NUMBER_ONLY = dimension()
"""The dimension of a number without unit."""
TIME = dimension(s=1)
"""The dimension of a time."""
ANGLE = dimension(rad=1)
"""The dimension of an angle."""


class Quantity(NamedTuple):
    """A value in SI units, its dimension, and its text."""

    si: float
    dimension: Dimension
    text: str


def unit_in(text: str) -> str | None:
    """Return the unit in the text of a quantity; None if the text is not a quantity."""
    found = _QUANTITY.fullmatch(text)
    return None if found is None else found.group(2)


class QuantityError(ValueError):
    """A text that is not a quantity, or has the wrong dimension."""


def parse_quantity(text: str) -> Quantity:
    """Parse the text of a quantity.

    Raises
    ------
    QuantityError : not a number with a unit, an unknown unit, or out of range.
    """
    found = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    if found is None:
        raise QuantityError(f'a number and a unit, as in "50 ms"; got {text[:_LONGEST]!r}')
    factor, offset, measured = _unit(found[2])
    try:
        exact = Decimal(found[1].replace("_", "")) * factor + offset
        si = float(exact)
    except (InvalidOperation, OverflowError) as error:  # pragma: no cover - by the grammar
        raise QuantityError(f"a number in range; got {text!r}") from error
    if si in (float("inf"), float("-inf")):
        raise QuantityError(f"a number in range; got {text!r}")
    return Quantity(si, measured, text.strip())


def quantity_in(text: str, wanted: Dimension) -> float:
    """Parse a quantity of the dimension `wanted` and return its SI value; see `check_dimension`."""
    found = parse_quantity(text)
    check_dimension(found, wanted)
    return found.si


Seconds = float | str
"""A time: a number of seconds, or a text with a unit, as "50 ms"."""


def seconds(value: Seconds, where: str) -> float:
    """Return a time in seconds, given as a number of them or as a text with a unit.

    Raises
    ------
    InputError : anything else, at `where`.
    """
    try:
        return quantity_in(value, TIME) if isinstance(value, str) else float(value)
    except (TypeError, ValueError) as error:
        words = str(error) if isinstance(error, QuantityError) else None
        raise InputError(
            "not a time",
            where=where,
            expected='seconds, or a text with a unit, as "50 ms"',
            got=words or repr(value),
        ) from error


def check_dimension(found: Quantity, wanted: Dimension) -> None:
    """Raise a QuantityError that names both dimensions if they differ."""
    if found.dimension != wanted:
        raise QuantityError(
            f"a value in {wanted}; {found.text!r} is in {found.dimension}"
            + _rotations(found.dimension, wanted)
        )


def _rotations(found: Dimension, wanted: Dimension) -> str:
    apart = wanted.without_angle() == found.without_angle()
    return " (1 Hz is 2 pi rad/s: write rad/s, deg/s or rpm)" if apart and wanted.angle else ""


@cache
def _unit(text: str) -> tuple[Decimal, Decimal, Dimension]:
    """Return factor and offset to SI, and the dimension, of a unit."""
    factors = _FACTORS.findall(text.removeprefix("1/"))
    if len(factors) == 1 and not factors[0][2] and not text.startswith("1/"):
        return _named(factors[0][1])
    factor, measured = Decimal(1), NUMBER_ONLY
    for i, (sign, name, power) in enumerate(factors):
        below = sign == "/" or (i == 0 and text.startswith("1/"))
        exponent = int(power or 1) * (-1 if below else 1)
        one, offset, of_one = _named(name)
        if offset:
            raise QuantityError(f"a unit without an offset within {text!r}; got {name!r}")
        factor *= one**exponent
        measured = measured * of_one.power(Fraction(exponent))
    return factor, Decimal(0), measured


@cache
def _named(name: str) -> tuple[Decimal, Decimal, Dimension]:
    """Return factor and offset to SI, and the dimension, of a named unit, with a prefix or not."""
    units, prefixes = _table()
    stems = [name, *([name[:-1]] if name.endswith("s") else [])]
    for stem in stems:
        for prefix, size in (("", Decimal(1)), *prefixes.items()):
            rest = stem.removeprefix(prefix)
            if len(stem) - len(rest) != len(prefix) or rest not in units:
                continue
            if stem is not name and len(rest) == 1:  # "ms" is no plural of "m"
                continue
            unit = units[rest]
            if unit is None:
                raise QuantityError(f"a unit of physics; {name!r} is none")
            factor, offset, measured = unit
            if offset and prefix:
                raise QuantityError(f"a known unit; {name!r} is none: {rest!r} takes no prefix")
            return (size * factor if prefix else factor), offset, measured
    raise QuantityError(f"a known unit; {name!r} is none")


@cache
def _table() -> tuple[dict[str, tuple[Decimal, Decimal, Dimension] | None], dict[str, Decimal]]:
    """Return the units by name, None for those that are refused, and the prefixes."""
    units: dict[str, tuple[Decimal, Decimal, Dimension] | None] = {}
    prefixes: dict[str, Decimal] = {}
    for line in files("cosim.core").joinpath("units.txt").read_text("utf-8").splitlines():
        match line.split():
            case ["#", *_]:
                pass
            case ["prefix", size, *names]:
                prefixes |= dict.fromkeys(names, Decimal(size))
            case ["refused", *names]:
                units |= dict.fromkeys(names)
            case [factor, offset, measured, *names]:
                unit = Decimal(factor), Decimal(offset), _dimension_of(measured)
                units |= dict.fromkeys(names, unit)
    return units, prefixes


def _dimension_of(text: str) -> Dimension:
    """Return the dimension in the table of units: "kg.m-1.s-2", or "1" for a number."""
    powers = {found[1]: Fraction(found[2] or 1) for found in _POWER.finditer(text)}
    return Dimension(tuple(powers.get(base, Fraction(0)) for base in _BASES))
