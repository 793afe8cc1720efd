"""Make ports of the variables that a model description declares."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import prod
from typing import Any

from lxml import etree

from cosim.fmu.clock import declared_clock
from cosim.fmu.port import TYPE_MAPPINGS, FmiVersion, Port, SignalKind, parse_start, parse_value


def declared_ports(model: Any, xml: bytes, version: FmiVersion) -> dict[str, Port]:
    """Return every variable by name, from fmpy's model description and its XML.

    Raises
    ------
    ValueError : start values that do not fit.
    """
    direct, undeclared = _feedthrough(model)
    words = _Words(xml) if version == "3.0" else None
    names = {v.valueReference: v.name for v in reversed(model.modelVariables)}
    ports = {}
    for variable in model.modelVariables:
        type_mapping = TYPE_MAPPINGS[version][variable.type]
        key = _key(model, variable)
        low, high = _range(variable, words, type_mapping.kind)
        declared = variable.declaredType
        shape = tuple(variable.shape or ())
        start = [] if variable.start is None else [str(variable.start)]
        if words is not None:
            start = words.start(variable, shape)
        if shape and len(start) > 1 and len(start) != prod(shape):
            raise ValueError(
                f"{variable.name} has {len(start)} start values for {prod(shape)} elements"
            )
        ports[variable.name] = Port(
            name=variable.name,
            reference=variable.valueReference,
            causality=variable.causality,
            variability="discrete"
            if type_mapping.kind != "float" and variable.variability == "continuous"
            else variable.variability,
            kind=type_mapping.kind,
            unit=variable.unit or (declared.unit if declared is not None else None),
            start=parse_start(type_mapping.kind, start, shape),
            minimum=low,
            maximum=high,
            description=variable.description,
            feedthrough=key in direct,
            getter_type=type_mapping.getter_type,
            c_type=type_mapping.c_type,
            shape=shape,
            dimensions=tuple(
                d.start if d.start is not None else names[d.valueReference]
                for d in variable.dimensions
            ),
            initial=variable.initial,
            items=_items(variable),
            nominal=_nominal(variable, words, type_mapping.kind),
            feedthrough_declared=key not in undeclared,
            clock=declared_clock(partial(words.clock, variable))
            if words is not None and variable.type == "Clock"
            else None,
            clocks=tuple(clock.name for clock in variable.clocks or ()),
            intermediate=words is not None
            and words.get(variable, "intermediateUpdate") in ("true", "1"),
        )
    return ports


class _Words:
    """Attributes of an FMI 3 description that fmpy does not read, from the XML itself."""

    def __init__(self, xml: bytes) -> None:
        parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
        root = etree.fromstring(xml, parser)
        found, types = root.find("ModelVariables"), root.find("TypeDefinitions")
        self._elements = {} if found is None else {v.get("name"): v for v in found}
        self._types = {} if types is None else {t.get("name"): t for t in types}

    def get(self, variable: Any, attribute: str) -> str | None:
        """Return an attribute of a variable, or of the one that it is an alias of."""
        value = self._element(variable).get(attribute)
        return None if value is None else str(value)

    def clock(self, variable: Any, attribute: str) -> str | None:
        """Return an attribute of a Clock, its own or else its type's."""
        own = self.get(variable, attribute)
        declared = self._types.get(self.get(variable, "declaredType"))
        found = declared.get(attribute) if own is None and declared is not None else own
        return None if found is None else str(found)

    def start(self, variable: Any, shape: tuple[int, ...]) -> list[str]:
        """Return the words of all start values: an element per text, one attribute of numbers."""
        element = self._element(variable)
        if variable.type in ("String", "Binary"):
            return [str(s.get("value")) for s in element.findall("Start")]
        text = element.get("start")
        if text is None:
            return []
        return str(text).split() if shape else [str(text)]

    def _element(self, variable: Any) -> Any:
        return self._elements[(variable.alias or variable).name]


def _range(
    variable: Any, words: _Words | None, kind: SignalKind | None
) -> tuple[float | None, float | None]:
    """Return the least and greatest value of a number, its own or else its type's."""
    if kind not in ("float", "int"):
        return None, None
    low, high = variable.min, variable.max
    if words is not None:
        low, high = words.get(variable, "min"), words.get(variable, "max")
    declared = variable.declaredType
    if declared is not None:
        low = declared.min if low is None else low
        high = declared.max if high is None else high
    return (
        None if low is None else parse_value(kind, low),
        None if high is None else parse_value(kind, high),
    )


def _nominal(variable: Any, words: _Words | None, kind: SignalKind | None) -> float | None:
    """Return the nominal value of a real number, its own or else its type's."""
    own = variable.nominal if words is None else words.get(variable, "nominal")
    declared = variable.declaredType
    found = own if own is not None or declared is None else declared.nominal
    return None if kind != "float" or found is None else float(found) or None


def _items(variable: Any) -> tuple[int, ...]:
    declared = variable.declaredType
    if variable.type != "Enumeration" or declared is None:
        return ()
    return tuple(int(item.value) for item in declared.items)


def _key(model: Any, variable: Any) -> Any:
    """Return a name in FMI 2, where two variables may share a reference; a reference in FMI 3."""
    return variable.name if model.fmiVersion == "2.0" else variable.valueReference


def _feedthrough(model: Any) -> tuple[set[Any], set[Any]]:
    """Return the outputs with direct feedthrough, and those of them that do not declare it.

    Undeclared dependencies mean all inputs (FMI 2.0.4 2.2.8, FMI 3.0 2.4.8). A time-based Clock is
    an input that depends on nobody: the master lets it tick before values are exchanged.
    """
    declared = {_key(model, unknown.variable): unknown.dependencies for unknown in model.outputs}
    found, undeclared = set(), set()
    for variable in model.modelVariables:
        if variable.causality == "output":
            key = _key(model, variable)
            dependencies: Iterable[Any] | None = declared.get(key)
            given = model.modelVariables if dependencies is None else dependencies
            if any(v.causality == "input" and not _is_time_based(v) for v in given):
                found.add(key)
                if dependencies is None:
                    undeclared.add(key)
    return found, undeclared


def _is_time_based(variable: Any) -> bool:
    """Whether a variable is a Clock that ticks by the time (of FMI 3.0)."""
    return bool(variable.type == "Clock" and variable.intervalVariability != "triggered")
