"""Read the parameter values of an element, apply mappings, and convert them for its FMU."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lxml import etree

from cosim.fmu import FmuDescription, Port
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import NAMESPACES, tag
from cosim.scenario.ssp.structure import TYPES
from cosim.scenario.ssp.units import UnitBase, converted, units_of_fmu

LINEAR = "LinearTransformation"

_SET = "application/x-ssp-parameter-set"
_MAPPING = "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class BoundValue:
    """A value bound to a variable of an element.

    Attributes
    ----------
    name : of the variable; in a system's binding, prefixed by the names of its elements.
    type, text, unit : as in the file.
    factor, offset : of the mapping that was applied.
    where : entry and line.
    """

    name: str
    type: str
    text: str
    unit: str | None
    where: str
    factor: float = 1.0
    offset: float = 0.0

    def value(self, archive: Archive) -> float | int | bool | str:
        """Return the value in Python; an InputError if its type is not supported."""
        plain = (self.factor, self.offset) == (1.0, 0.0)
        if self.type == "Real":
            value = archive.as_number(self.text, self.where)
            return value if plain else value * self.factor + self.offset
        if self.type in ("Integer", "Boolean", "String") and plain:
            if self.type == "Boolean":
                return self.text.strip() in ("true", "1")
            if self.type == "String":
                return self.text
            value = archive.as_number(self.text, self.where)
            if value == int(value):
                return int(value)
        raise archive.wrong(
            "a parameter value that is not supported",
            self.where,
            expected="Real, Integer, Boolean or String; transformed: Real",
            got=f"{self.name}: {self.type} {self.text}",
        )


def bound_values(archive: Archive, element: Any, base: str) -> list[BoundValue]:
    """Return the values of all bindings of an element, in order: the last one wins.

    Raises
    ------
    InputError : a missing or invalid file, or a kind of binding that is not supported.
    """
    found: list[BoundValue] = []
    for binding in element.findall(
        f"{tag('ssd', 'ParameterBindings')}/{tag('ssd', 'ParameterBinding')}"
    ):
        where = f"{base}:{binding.sourceline}"
        _supported(archive, binding, _SET, where)
        values = _values(archive, binding, base, where)
        mapping = binding.find(tag("ssd", "ParameterMapping"))
        if mapping is not None:
            _supported(archive, mapping, _MAPPING, where)
            values = _mapped(archive, mapping, values, base, where)
        prefix = binding.get("prefix", "")
        found += [replace(value, name=prefix + value.name) for value in values]
    return found


def _supported(archive: Archive, element: Any, kind: str, where: str) -> None:
    got = element.get("type", kind)
    if got != kind or element.get("sourceBase", "SSD") != "SSD":
        raise archive.wrong(
            "parameters of this kind are not supported",
            where,
            expected=f"{kind}, its source beside the SSD",
            got=f"{got}, {element.get('sourceBase', 'SSD')}",
        )


def _values(archive: Archive, binding: Any, base: str, where: str) -> list[BoundValue]:
    source = binding.get("source")
    if source:
        entry = archive.entry(source, base, where)
        sets = [archive.xml(entry, "SystemStructureParameterValues")]
    else:
        entry = base
        path = f"{tag('ssd', 'ParameterValues')}/{tag('ssv', 'ParameterSet')}"
        sets = binding.findall(path)
    return [
        _value(archive, parameter, entry)
        for one in sets
        for parameter in one.iter(tag("ssv", "Parameter"))
    ]


def _value(archive: Archive, parameter: Any, entry: str) -> BoundValue:
    where = f"{entry}:{parameter.sourceline}"
    start = f"{{{NAMESPACES['ssv']}}}"
    kinds = [child for child in parameter.iterchildren(tag=etree.Element) if child.get("value")]
    if not kinds or not kinds[0].tag.startswith(start):
        raise archive.wrong("a parameter without a value", where, got=parameter.get("name"))
    return BoundValue(
        name=archive.needed(parameter, "name", entry),
        type=kinds[0].tag.removeprefix(start),
        text=kinds[0].get("value"),
        unit=kinds[0].get("unit"),
        where=where,
    )


def _mapped(
    archive: Archive, mapping: Any, values: Sequence[BoundValue], base: str, where: str
) -> list[BoundValue]:
    """Rename and transform values by a mapping; values that it does not name are dropped."""
    source = mapping.get("source")
    if source:
        entry = archive.entry(source, base, where)
        root = archive.xml(entry, "SystemStructureParameterMapping")
    else:
        entry, root = base, mapping.find(tag("ssm", "ParameterMapping"))
    entries: Sequence[Any] = [] if root is None else list(root.iter(tag("ssm", "MappingEntry")))
    by_name: Mapping[str, BoundValue] = {value.name: value for value in values}
    found = []
    for item in entries:
        at = f"{entry}:{item.sourceline}"
        target = archive.needed(item, "target", entry)
        value = by_name.get(item.get("source"))
        if value is None:
            raise archive.wrong("a mapping of an unknown parameter", at, got=item.get("source"))
        factor, offset = 1.0, 0.0
        for kind, *numbers in transformations(archive, item, entry):
            if kind != LINEAR:
                what = "this transformation of a parameter is not supported"
                raise archive.wrong(what, at, expected=LINEAR, got=kind)
            factor, offset = numbers
        found.append(replace(value, name=target, factor=factor, offset=offset))
    return found


def transformations(
    archive: Archive, element: Any, entry: str
) -> Iterator[tuple[str, float, float]]:
    """Yield kind, factor and offset of the transformations in a mapping or a connection."""
    for child in element.iterchildren(tag=etree.Element):
        kind = str(child.tag).removeprefix(f"{{{NAMESPACES['ssc']}}}")
        if kind.endswith("Transformation"):
            factor = archive.number(child, "factor", entry, 1.0)
            yield kind, factor, archive.number(child, "offset", entry, 0.0)


def values_for(
    archive: Archive,
    name: str,
    bound: Sequence[BoundValue],
    fmu: FmuDescription,
    units: Mapping[str, UnitBase],
) -> dict[str, Any]:
    """Convert values bound to the component `name` to the types and units of its FMU.

    `units` : defined by the archive.

    Raises
    ------
    InputError : a variable that the FMU does not have, or a value of another type or unit.
    """
    values = {}
    for one in bound:
        port = fmu.ports.get(one.name)
        if port is None:
            near = difflib.get_close_matches(one.name, list(fmu.ports), n=3, cutoff=0.5)
            raise archive.wrong(
                f"{name} has no variable {one.name!r}",
                one.where,
                hint=f"did you mean {' or '.join(near)}?" if near else None,
            )
        values[one.name] = _in_unit_of(archive, one, port, fmu, units)
    return dict(sorted(values.items()))


def _in_unit_of(
    archive: Archive,
    bound: BoundValue,
    port: Port,
    fmu: FmuDescription,
    units: Mapping[str, UnitBase],
) -> Any:
    value = bound.value(archive)
    fits = port.kind is not None and TYPES[port.kind] == bound.type
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
    own = units_of_fmu(fmu.model)
    of, to = units.get(bound.unit) or own.get(bound.unit), own.get(port.unit)
    try:
        if of is not None and to is not None:
            return converted(float(value), of, to)
        reason = "one of the units is not defined"
    except ValueError as error:
        reason = str(error)
    raise archive.wrong(
        f"{bound.name} has a unit that cannot be converted",
        bound.where,
        expected=f"{port.unit}",
        got=f"{bound.unit}: {reason}",
    )
