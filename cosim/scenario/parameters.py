"""Parameters and start values of a component: of the type, shape and unit of their variables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cosim.core import InputError
from cosim.fmu import FmuDescription, Port, checked_scalars, describe_settable, may_be_set
from cosim.scenario.origin import Findings
from cosim.scenario.units import in_unit_of


def numbers_of(
    name: str, fmu: FmuDescription, parameters: Mapping[str, Any], findings: Findings
) -> dict[str, Any]:
    """The parameters of the component `name` as its FMU takes them: texts with units resolved.

    What is refused goes to `findings` and is left out.
    """
    found: dict[str, Any] = {}
    for variable, value in parameters.items():
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
    return {variable: found[variable] for variable in parameters if variable in found}


def in_own_unit(fmu: FmuDescription, port: Port, value: Any) -> Any:
    """A value with texts resolved that have a unit, and whole numbers as floats for a Real."""
    if port.kind == "float" and isinstance(value, str):
        return in_unit_of(fmu, port, value, port.name)
    if isinstance(value, list):
        return [in_own_unit(fmu, port, item) for item in value]
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if port.kind == "float" and whole else value


def _check(port: Port, value: Any) -> None:
    """See that the FMU can take a value before the run begins.

    Raises
    ------
    InputError : a variable that cannot be set, another type or shape, out of range.
    """
    if not may_be_set(port, "instantiated") and port.causality != "structuralParameter":
        raise InputError(f"{port.name} cannot be set", got=describe_settable(port))
    checked_scalars(port, value, port.name)
