"""Parameter values of an element: inline or from .ssv files, renamed by mappings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lxml import etree

from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import NAMESPACES, tag

_SET = "application/x-ssp-parameter-set"
_MAPPING = "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class BoundValue:
    """A value that is bound to an element, by the name that it has there.

    Attributes
    ----------
    name : of a variable; from a system's binding with the elements' names before it.
    type, text, unit : as the file has them.
    factor, offset : of the mapping that brought it here.
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
        """The value in Python.

        Raises
        ------
        InputError : of a type that a scenario has no word for, or transformed and no number.
        """
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
    """Values of all bindings of an element, in the order in which they apply: the last wins.

    Raises
    ------
    InputError : a file that is missing or not valid, or a kind of binding that is not supported.
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
    """Values by the names that the mapping gives them; what it does not name is not applied."""
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
            raise archive.wrong(
                "a mapping of a parameter that is not there", at, got=item.get("source")
            )
        factor, offset = 1.0, 0.0
        for child in item.iterchildren(tag=etree.Element):
            local = str(child.tag).removeprefix(f"{{{NAMESPACES['ssc']}}}")
            if local == "LinearTransformation":
                factor = archive.number(child, "factor", entry, 1.0)
                offset = archive.number(child, "offset", entry, 0.0)
            elif local.endswith("Transformation"):
                raise archive.wrong(
                    "this transformation of a parameter is not supported",
                    at,
                    expected="LinearTransformation",
                    got=local,
                )
        found.append(replace(value, name=target, factor=factor, offset=offset))
    return found
