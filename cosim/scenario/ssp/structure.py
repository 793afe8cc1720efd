"""Data model of SystemStructure.ssd: elements with connectors and parameters, connections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

SspType = Literal["Real", "Integer", "Boolean", "String"]

TYPES: Mapping[str | None, SspType] = {
    "float": "Real",
    "int": "Integer",
    "bool": "Boolean",
    "string": "String",
}
"""`Port.kind` -> type in SSP."""


@dataclass(frozen=True)
class Connector:
    """A connected input or output."""

    name: str
    kind: Literal["input", "output"]
    type: SspType
    unit: str | None = None


@dataclass(frozen=True)
class Value:
    """A start value."""

    type: SspType
    value: Any
    unit: str | None = None

    @property
    def text(self) -> str:
        """The value as in XML schema; a double in the shortest form that reads back equal."""
        if self.type == "Boolean":
            return "true" if self.value else "false"
        if self.type == "Integer":
            return str(int(self.value))
        return repr(float(self.value)) if self.type == "Real" else str(self.value)


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
    """A connection; `link` is the name of an annotated link."""

    source: tuple[str, str]
    target: tuple[str, str]
    link: str | None = None


@dataclass(frozen=True)
class Structure:
    """The content of SystemStructure.ssd.

    Attributes
    ----------
    units : name -> exponents of base units, factor and offset.
    links : TOML of each annotated link by its name.
    run : TOML of [run].
    rest : TOML of what SSP cannot express; may be empty.
    step_s, end_s : communication step and end [s].
    """

    name: str
    description: str
    elements: Sequence[Element]
    wires: Sequence[Wire]
    units: Mapping[str, Mapping[str, str]]
    links: Mapping[str, str]
    run: str
    rest: str
    step_s: float
    end_s: float
