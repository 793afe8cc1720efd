"""Convert values of a scenario to the types and units of FMU variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from cosim.core import (
    Dimension,
    Findings,
    InputError,
    QuantityError,
    check_dimension,
    dimension,
    number_in_quotes,
    parse_quantity,
)
from cosim.fmu import FmuDescription, Port, checked_scalars, describe_settable, may_be_set
from cosim.scenario.values import parse_value


@dataclass(frozen=True)
class DeclaredUnit:
    """A unit of an FMU: SI value = factor * value + offset.

    `dimension` is None for a unit that neither the FMU nor `quantity` defines.
    """

    name: str
    dimension: Dimension | None
    factor: float = 1.0
    offset: float = 0.0

    def to_si(self, value: Any) -> Any:
        """Convert a value of the variable, or an array of them, to SI."""
        if self.factor == 1.0 and self.offset == 0.0:
            return value
        return self.factor * value + self.offset

    def from_si(self, value: float) -> float:
        """Convert an SI value to this unit."""
        if self.factor == 1.0 and self.offset == 0.0:
            return value
        return (value - self.offset) / self.factor


def unit_of(fmu: FmuDescription, port: Port) -> DeclaredUnit | None:
    """Return the unit of a variable as the FMU defines it, else by its name; None without one."""
    if not port.unit:
        return None
    base = fmu.units.get(port.unit)
    if base is not None:
        measured = Dimension((*map(Fraction, base.exponents), Fraction(0)))
        return DeclaredUnit(port.unit, measured, base.factor, base.offset)
    try:
        named = parse_quantity(f"1 {port.unit}")
        origin = parse_quantity(f"0 {port.unit}")
    except QuantityError:
        return DeclaredUnit(port.unit, None)
    return DeclaredUnit(port.unit, named.dimension, named.si - origin.si, origin.si)


def in_unit_of(fmu: FmuDescription, port: Port, text: str, where: str) -> float:
    """Convert a text with a unit to a number in the variable's unit.

    Raises
    ------
    InputError : not a quantity, or one of another dimension than the variable's; names both.
    """
    declared = unit_of(fmu, port)
    try:
        found = parse_value(text)
        if declared is not None and declared.dimension is not None:
            # many exporters write rad/s as 1/s: to them angles are numbers
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
            hint=number_in_quotes(text),
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


def numbers_of(
    name: str,
    fmu: FmuDescription,
    parameters: Mapping[str, Any],
    findings: Findings,
    known: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Convert the parameters of the component `name` to the types and units of its FMU.

    Refused ones are reported to `findings` and left out.

    known : some of them, as this function has converted them.
    """
    known = known or {}
    found: dict[str, Any] = {}
    for variable, value in parameters.items():
        if variable in known:
            continue
        with findings.at("components", name, "parameters", variable):
            port = fmu.port(variable, where=f"component {name!r}")
            found[variable] = in_own_unit(fmu, port, value)
    resized = fmu
    with findings.at("components", name, "parameters"):
        resized = fmu.resized(found)
    for variable, value in list(found.items()):
        with findings.at("components", name, "parameters", variable):
            del found[variable]
            _check(resized.ports[variable], value)
            found[variable] = value
    found |= known
    return {variable: found[variable] for variable in parameters if variable in found}


def in_own_unit(fmu: FmuDescription, port: Port, value: Any) -> Any:
    """Convert texts with a unit, and whole numbers to floats, for a variable of type Real."""
    if port.kind == "float" and isinstance(value, str):
        return in_unit_of(fmu, port, value, port.name)
    if isinstance(value, list):
        return [in_own_unit(fmu, port, item) for item in value]
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if port.kind == "float" and whole else value


def _check(port: Port, value: Any) -> None:
    """Refuse a variable that cannot be set, or a value of wrong type, wrong shape or range."""
    if not may_be_set(port, "instantiated") and port.causality != "structuralParameter":
        raise InputError(f"{port.name} cannot be set", got=describe_settable(port))
    checked_scalars(port, value, port.name)
