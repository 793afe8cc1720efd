"""Units of FMU variables: what a text with a unit is in the unit that the FMU declares."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cosim.core import InputError
from cosim.fmu import FmuDescription, Port
from cosim.scenario.quantity import (
    Dimension,
    QuantityError,
    check_dimension,
    dimension,
    parse_quantity,
)

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class DeclaredUnit:
    """A unit of an FMU: SI value = factor * value + offset.

    `dimension` is None where the FMU names a unit that neither it nor Pint explains.
    """

    name: str
    dimension: Dimension | None
    factor: float = 1.0
    offset: float = 0.0

    def to_si(self, value: Any) -> Any:
        """A value of the variable, or an array of them, in SI."""
        if self.factor == 1.0 and self.offset == 0.0:
            return value
        return self.factor * value + self.offset

    def from_si(self, value: float) -> float:
        """An SI value in this unit."""
        if self.factor == 1.0 and self.offset == 0.0:
            return value
        return (value - self.offset) / self.factor


def unit_of(fmu: FmuDescription, port: Port) -> DeclaredUnit | None:
    """The unit of a variable, by the FMU's own definition, else by its name; None without one."""
    if not port.unit:
        return None
    for unit in fmu.model.unitDefinitions:
        if unit.name == port.unit and unit.baseUnit is not None:
            base = unit.baseUnit
            exponents = tuple(Fraction(int(getattr(base, b) or 0)) for b in _BASES)
            measured = Dimension((*exponents, Fraction(0)))
            return DeclaredUnit(port.unit, measured, float(base.factor), float(base.offset))
    try:
        named = parse_quantity(f"1 {port.unit}")
        origin = parse_quantity(f"0 {port.unit}")
    except QuantityError:
        return DeclaredUnit(port.unit, None)
    return DeclaredUnit(port.unit, named.dimension, named.si - origin.si, origin.si)


def in_unit_of(fmu: FmuDescription, port: Port, text: str, where: str) -> float:
    """A text with a unit as a number in the variable's own unit.

    Raises
    ------
    InputError : no quantity, or one of another dimension than the variable's; names both.
    """
    declared = unit_of(fmu, port)
    try:
        found = parse_quantity(text)
        if declared is not None and declared.dimension is not None:
            # many exporters write rad/s as 1/s: then angles are numbers to them
            if found.dimension.without_angle() != declared.dimension:
                check_dimension(found, declared.dimension)
            return declared.from_si(found.si)
    except QuantityError as error:
        wanted = port.unit or "the variable's unit"
        raise InputError(
            f"{port.name} is measured in {wanted}",
            where=where,
            expected=f"a number in {wanted}, or {error}",
            got=repr(text),
        ) from error
    if declared is None and found.dimension == dimension():
        return found.si
    raise InputError(
        f"{port.name} has no unit that could be compared",
        where=where,
        expected="a plain number",
        got=f"{text!r}, and the FMU {fmu.path.name} declares "
        + ("no unit" if declared is None else f"{declared.name!r} without saying what that is"),
    )
