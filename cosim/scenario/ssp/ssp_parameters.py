"""Read the parameter values of an element, apply mappings, and convert them for its FMU."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lxml import etree

from cosim.fmu import FmuDescription, Port, UnitBase
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import LINEAR, NAMESPACES, tag
from cosim.scenario.ssp.structure import FLOATS, INTEGERS

_SET = "application/x-ssp-parameter-set"
_MAPPING = "application/x-ssp-parameter-mapping"


_KIND = {
    **dict.fromkeys(FLOATS, "float"),
    **dict.fromkeys(INTEGERS, "int"),
    "Boolean": "bool",
    "String": "string",
}


@dataclass(frozen=True)
class BoundValue:
    """A value bound to a variable of an element.

    Attributes
    ----------
    name : of the variable; in a system's binding, prefixed by the names of its elements.
    type, unit : as in the file.
    texts : the value's elements as in the file; of a scalar, one.
    where : entry and line.
    factor, offset : of the mapping that was applied, after the conversion of units.
    """

    name: str
    type: str
    texts: tuple[str, ...]
    unit: str | None
    where: str
    factor: float = 1.0
    offset: float = 0.0

    def values(self, archive: Archive) -> list[Any]:
        """Return the elements in Python, as yet untransformed; an InputError for other types."""
        kind = _KIND.get(self.type)
        if kind is None or ((self.factor, self.offset) != (1.0, 0.0) and kind != "float"):
            raise archive.wrong(
                "a parameter value that is not supported",
                self.where,
                expected="a number, Boolean or String; transformed: a real number",
                got=f"{self.name}: {self.type} {' '.join(self.texts)}",
            )
        return [self._value(archive, kind, text) for text in self.texts]

    def _value(self, archive: Archive, kind: str, text: str) -> Any:
        if kind == "bool":
            return text.strip() in ("true", "1")
        if kind == "string":
            return text
        if kind == "float":
            return archive.as_number(text, self.where)
        try:
            return int(text)  # a UInt64 may be more than a double holds
        except ValueError:
            value = archive.as_number(text, self.where)
        if value == int(value):
            return int(value)
        raise archive.wrong("not a whole number", self.where, got=f"{self.name}: {text}")


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
    kinds = [c for c in parameter.iterchildren(tag=etree.Element) if str(c.tag).startswith(start)]
    if not kinds:
        raise archive.wrong("a parameter without a value", where, got=parameter.get("name"))
    kind = kinds[0].tag.removeprefix(start)
    text = kinds[0].get("value")
    if text is None:  # an array of texts has an element for each
        texts = [archive.needed(e, "value", entry) for e in kinds[0].iterfind(tag("ssv", "Value"))]
    else:
        texts = [text] if kind == "String" else text.split()
    if not texts:
        raise archive.wrong("a parameter without a value", where, got=parameter.get("name"))
    return BoundValue(
        name=archive.needed(parameter, "name", entry),
        type=kind,
        texts=tuple(texts),
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
        unit = None if item.get("suppressUnitConversion") in ("true", "1") else value.unit
        found.append(replace(value, name=target, factor=factor, offset=offset, unit=unit))
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
    unknown = [one for one in bound if one.name not in fmu.ports]
    if unknown:
        near = difflib.get_close_matches(unknown[0].name, list(fmu.ports), n=3, cutoff=0.5)
        raise archive.wrong(
            f"{name} has no variable {unknown[0].name!r}",
            unknown[0].where,
            hint=f"did you mean {' or '.join(near)}?" if near else None,
        )
    values: dict[str, Any] = {}
    for shaping in (True, False):  # structural parameters first: arrays have the lengths they give
        for one in bound:
            port = fmu.ports[one.name]
            if (port.causality == "structuralParameter") == shaping:
                values[one.name] = _in_unit_of(archive, one, port, fmu, units)
        fmu = fmu.resized(values)
    return dict(sorted(values.items()))


def _in_unit_of(
    archive: Archive,
    bound: BoundValue,
    port: Port,
    fmu: FmuDescription,
    units: Mapping[str, UnitBase],
) -> Any:
    values = bound.values(archive)
    fits = port.kind == _KIND[bound.type] or (port.kind, _KIND[bound.type]) == ("float", "int")
    if not fits or len(values) not in (1, port.size):
        size = f", {port.size} numbers" if port.shape else ""
        raise archive.wrong(
            "a value of the wrong type",
            bound.where,
            expected=f"{port.getter_type}{size} for {bound.name}",
            got=bound.type + (f", {len(values)} numbers" if len(values) > 1 else ""),
        )
    if port.kind == "float":
        convert = _conversion(archive, bound, port, fmu, units)
        values = [convert(float(value)) for value in values]
        if (bound.factor, bound.offset) != (1.0, 0.0):
            values = [value * bound.factor + bound.offset for value in values]
    if not port.shape:
        return values[0]
    values = values * (port.size // len(values))
    return np.reshape(np.array(values, dtype=object), port.shape).tolist()


def _conversion(
    archive: Archive,
    bound: BoundValue,
    port: Port,
    fmu: FmuDescription,
    units: Mapping[str, UnitBase],
) -> Callable[[float], float]:
    """Return what converts a value to the unit of the variable."""
    if bound.unit is None or port.unit is None or bound.unit == port.unit:
        return lambda value: value
    own = fmu.units
    of, to = units.get(bound.unit) or own.get(bound.unit), own.get(port.unit)
    reason = "one of the units is not defined"
    if of is not None and to is not None:
        if of.exponents == to.exponents:
            return lambda value: of.convert(value, to)
        reason = "the units measure different things"
    raise archive.wrong(
        f"{bound.name} has a unit that cannot be converted",
        bound.where,
        expected=f"{port.unit}",
        got=f"{bound.unit}: {reason}",
    )
