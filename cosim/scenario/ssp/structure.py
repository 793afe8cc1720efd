"""Data model of SystemStructure.ssd: elements with connectors and parameters, connections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from cosim.fmu import Port, UnitBase
from cosim.scenario.ssp.names import SspVersion

TYPES: Mapping[str | None, str] = {
    "float": "Real",
    "int": "Integer",
    "bool": "Boolean",
    "string": "String",
}
"""`Port.kind` -> type in SSP 1.0."""

_SIZED = frozenset(
    {"Float32", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))} - {"Int32"}
)
FLOATS = ("Real", "Float64", "Float32")
INTEGERS = ("Integer", "Int32", *sorted(_SIZED - {"Float32"}))


def ssp_type(port: Port, version: SspVersion) -> str:
    """Return the type of a variable in SSP.

    A Float64 is a Real and an Int32 an Integer, which SSP 2.0 has as their other names: so tools
    of SSP 1.0 take them. Only SSP 2.0 has the other types of FMI 3.0.
    """
    if version == "2.0" and port.getter_type in _SIZED and not port.items:
        return port.getter_type
    return TYPES[port.kind]


@dataclass(frozen=True)
class Connector:
    """An input or output; `shape` of an array, which only SSP 2.0 has."""

    name: str
    kind: Literal["input", "output"]
    type: str
    unit: str | None = None
    shape: tuple[int, ...] = ()


@dataclass(frozen=True)
class Value:
    """A start value; of an array, with `shape`, a flat list, the last index fastest."""

    type: str
    value: Any
    unit: str | None = None
    shape: tuple[int, ...] = ()

    @property
    def texts(self) -> list[str]:
        """The elements as in XML schema; a double in the shortest form that reads back equal."""
        return [self._text(value) for value in (self.value if self.shape else [self.value])]

    def _text(self, value: Any) -> str:
        if self.type == "Boolean":
            return "true" if value else "false"
        if self.type in INTEGERS:
            return str(int(value))
        return repr(float(value)) if self.type in FLOATS else str(value)


@dataclass(frozen=True)
class Element:
    """A component.

    Attributes
    ----------
    source : path of its FMU in the archive.
    values : by variable.
    link : name and TOML of the link, if this is a link FMU.
    """

    name: str
    source: str
    connectors: Sequence[Connector]
    values: Mapping[str, Value] = field(default_factory=dict)
    link: tuple[str, str] | None = None


@dataclass(frozen=True)
class Wire:
    """A connection of factor * value + offset; `link` is the name of an annotated link."""

    source: tuple[str, str]
    target: tuple[str, str]
    link: str | None = None
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Structure:
    """The content of SystemStructure.ssd.

    Attributes
    ----------
    version : of SSP.
    labels : element -> name in the scenario, where they differ.
    units : those of the variables, by name.
    links : TOML of each annotated link by its name.
    run : TOML of [run].
    signals : TOML of the paths and time series of the scenario, and the element that plays those
        that move; empty: none.
    rest : TOML of what SSP cannot express; may be empty.
    step_s, start_s, end_s : communication step, start and end [s].
    """

    version: SspVersion
    name: str
    description: str
    elements: Sequence[Element]
    labels: Mapping[str, str]
    wires: Sequence[Wire]
    units: Mapping[str, UnitBase]
    links: Mapping[str, str]
    run: str
    signals: tuple[str, str | None]
    rest: str
    step_s: float
    start_s: float
    end_s: float
