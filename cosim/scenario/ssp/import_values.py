"""Parameter values of an archive as those of a scenario: names, types and units of the FMU."""

from __future__ import annotations

import difflib
from typing import Any

from cosim.fmu import FmuDescription, Port
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.flatten import FlatSystem, Path as Place
from cosim.scenario.ssp.parameters import BoundValue
from cosim.scenario.ssp.tree import Description
from cosim.scenario.ssp.units import UnitBase, converted, units_of_fmu

_KINDS = {"float": ("Real",), "int": ("Integer",), "bool": ("Boolean",), "string": ("String",)}


def table_of(values: dict[str, Any]) -> dict[str, Any]:
    """The table `parameters`, if there are any."""
    return {"parameters": values} if values else {}


def values_of(
    archive: Archive, flat: FlatSystem, place: Place, fmu: FmuDescription, description: Description
) -> dict[str, Any]:
    """Values of a component by variable.

    Raises
    ------
    InputError : a variable that the FMU does not have, or a value of another type or unit.
    """
    values = {}
    for bound in flat.parts[place].bound:
        port = fmu.ports.get(bound.name)
        if port is None:
            near = difflib.get_close_matches(bound.name, list(fmu.ports), n=3, cutoff=0.5)
            raise archive.wrong(
                f"{'.'.join(place)} has no variable {bound.name!r}",
                bound.where,
                hint=f"did you mean {' or '.join(near)}?" if near else None,
            )
        values[bound.name] = _value(archive, bound, port, fmu, description)
    return dict(sorted(values.items()))


def _value(
    archive: Archive, bound: BoundValue, port: Port, fmu: FmuDescription, description: Description
) -> Any:
    value = bound.value(archive)
    fits = port.kind is not None and bound.type in _KINDS[port.kind]
    if port.kind == "float" and bound.type == "Integer":
        value, fits = float(value), True
    if not fits or port.shape:
        raise archive.wrong(
            "a value of the wrong type",
            bound.where,
            expected=f"{port.getter_type} for {bound.name}",
            got=bound.type,
        )
    if bound.unit is None or port.unit is None or bound.unit == port.unit:
        return value
    of = description.units.get(bound.unit) or units_of_fmu(fmu.model).get(bound.unit)
    to = units_of_fmu(fmu.model).get(port.unit)
    return _in_unit(archive, bound, port, of, to, float(value))


def _in_unit(
    archive: Archive,
    bound: BoundValue,
    port: Port,
    of: UnitBase | None,
    to: UnitBase | None,
    value: float,
) -> float:
    try:
        if of is not None and to is not None:
            return converted(value, of, to)
        reason = "one of them is defined nowhere"
    except ValueError as error:
        reason = str(error)
    raise archive.wrong(
        f"{bound.name} in a unit that cannot be converted",
        bound.where,
        expected=f"{port.unit}",
        got=f"{bound.unit}: {reason}",
    )
