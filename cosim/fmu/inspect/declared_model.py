"""Read modelDescription.xml of FMI 1.0, 2.0 and 3.0 into one form, even if it is faulty.

FMPy's reader stops at the first reference that it cannot resolve; here every reference stays a
number, which the checks resolve.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

XML = "modelDescription.xml"
_KINDS = {
    "CoSimulation": "co-simulation",
    "ModelExchange": "model exchange",
    "ScheduledExecution": "scheduled execution",
}
_FMI2_ROLES = {"Outputs": "output", "Derivatives": "derivative", "InitialUnknowns": "initial"}
_FMI3_ROLES = {
    "Output": "output",
    "ContinuousStateDerivative": "derivative",
    "ClockedState": "clocked state",
    "InitialUnknown": "initial",
    "EventIndicator": "event indicator",
}
_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")
_FLOATS = ("Real", "Float32", "Float64")


@dataclass(slots=True)
class Variable:
    """A variable as written in the XML; None for missing attributes.

    Attributes
    ----------
    index : its position, from 1.
    reference : value reference.
    minimum, maximum, unit : its own, or else its declared type's.
    dimensions : one entry per dimension: (size, None) or (None, value reference).
    """

    index: int
    line: int
    name: str
    reference: int | None
    type: str
    causality: str
    variability: str
    start: str | None
    minimum: str | None
    maximum: str | None
    nominal: str | None
    unit: str | None
    declared_type: str | None
    derivative: int | None
    clocks: tuple[int, ...]
    dimensions: tuple[tuple[int | None, int | None], ...]

    @property
    def real(self) -> bool:
        """Whether it is a floating-point variable."""
        return self.type in _FLOATS

    @property
    def where(self) -> str:
        """The place that a finding names."""
        return f"{XML}:{self.line} {self.name}"


@dataclass(slots=True)
class Unknown:
    """An entry of ModelStructure: its role, target and dependencies.

    `target` and `dependencies` are indices from 1 in FMI 2, value references in FMI 3.
    """

    role: str
    line: int
    target: int | None
    dependencies: tuple[int, ...] | None
    kinds: tuple[str, ...] | None


@dataclass(slots=True)
class Interface:
    """A kind of use, such as co-simulation, with its attributes (capabilities) as written."""

    kind: str
    identifier: str
    attributes: Mapping[str, str]
    sources: tuple[str, ...]

    def is_true(self, attribute: str) -> bool:
        """Whether a Boolean attribute is true."""
        return self.attributes.get(attribute) in ("true", "1")


@dataclass(slots=True)
class Unit:
    """A unit with the attributes of its BaseUnit, or None."""

    name: str
    line: int
    base: Mapping[str, str] | None


@dataclass(slots=True)
class DeclaredModel:
    """A model description; `aliases` are the further names of variables in FMI 3."""

    version: str
    attributes: Mapping[str, str]
    interfaces: list[Interface] = field(default_factory=list)
    units: list[Unit] = field(default_factory=list)
    types: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    variables: list[Variable] = field(default_factory=list)
    aliases: list[str] = field(default_factory=list)
    structure: list[Unknown] = field(default_factory=list)
    experiment: Mapping[str, str] = field(default_factory=dict)

    @property
    def major(self) -> int:
        """The major version of FMI: 1, 2 or 3."""
        return int(self.version[0])

    @property
    def token(self) -> str | None:
        """The guid, or instantiationToken in FMI 3."""
        return self.attributes.get("instantiationToken" if self.major == 3 else "guid")

    def variables_by_target(self) -> Mapping[int, Variable]:
        """Return variables by number in ModelStructure: index in FMI 2, reference in FMI 3."""
        if self.major == 2:
            return {v.index: v for v in self.variables}
        return {v.reference: v for v in self.variables if v.reference is not None}


def known_version(version: str | None) -> bool:
    """Whether `read_declared_model` reads this version of FMI."""
    return version in ("1.0", "2.0") or (version or "").startswith("3.0")


def read_declared_model(root: Any) -> DeclaredModel:
    """Read the description below a root element with a `known_version`."""
    attributes = {str(key): str(value) for key, value in root.attrib.items()}
    model = DeclaredModel(attributes["fmiVersion"], attributes)
    model.interfaces = list(_interfaces(root, model.major, attributes))
    for element in root.findall("UnitDefinitions/" + ("BaseUnit" if model.major == 1 else "Unit")):
        base = element.find("BaseUnit")
        name = element.get("unit" if model.major == 1 else "name", "")
        model.units.append(
            Unit(name, element.sourceline, None if base is None else dict(base.attrib))
        )
    model.types = dict(_types(root, model.major))
    places = root.find("ModelVariables")
    for element in [] if places is None else places.iterchildren(tag="*"):
        model.variables.append(_variable(element, len(model.variables) + 1, model))
    if model.major == 3:
        model.aliases = [a.get("name", "") for a in root.findall("ModelVariables/*/Alias")]
    model.structure = list(_structure(root, model.major))
    experiment = root.find("DefaultExperiment")
    model.experiment = {} if experiment is None else dict(experiment.attrib)
    return model


def integer(text: str | None) -> int | None:
    """Read a whole number; None if it is not one."""
    try:
        return None if text is None else int(text)
    except ValueError:
        return None


def number(text: str | None) -> float | None:
    """Read a number of XML schema, truth values as 1 and 0; None if it is not one."""
    if text is None:
        return None
    plain = text.strip()
    if plain in ("true", "false"):
        return float(plain == "true")
    try:
        return float(plain)
    except ValueError:
        return None


def _interfaces(root: Any, major: int, attributes: Mapping[str, str]) -> Iterator[Interface]:
    if major == 1:
        implementation = root.find("Implementation")
        kind = "model exchange" if implementation is None else "co-simulation"
        capabilities = root.find("Implementation//Capabilities")
        found = {} if capabilities is None else dict(capabilities.attrib)
        if root.find("Implementation/CoSimulation_Tool") is not None:
            found["needsExecutionTool"] = "true"
        yield Interface(kind, attributes.get("modelIdentifier", ""), found, ())
        return
    for tag, kind in _KINDS.items():
        for element in root.findall(tag):
            sources = tuple(file.get("name", "") for file in element.findall("SourceFiles/File"))
            yield Interface(kind, element.get("modelIdentifier", ""), dict(element.attrib), sources)


def _types(root: Any, major: int) -> Iterator[tuple[str, Mapping[str, Any]]]:
    tag = {1: "Type", 2: "SimpleType", 3: "*"}[major]
    for element in root.findall(f"TypeDefinitions/{tag}"):
        inner = element if major == 3 else next(element.iterchildren(tag="*"), element)
        items = [item.get("value") for item in inner.findall("Item")]
        if major == 1:
            items = [str(i) for i, _ in enumerate(items, 1)]
        yield element.get("name", ""), {**inner.attrib, "items": items}


def _variable(element: Any, index: int, model: DeclaredModel) -> Variable:
    value = element
    if model.major < 3:
        value = next((child for child in element.iterchildren(*_TYPES)), None)
    kind = "" if value is None else str(value.tag)
    attributes = {} if value is None else value.attrib
    declared = attributes.get("declaredType")
    inherited = model.types.get(declared or "", {})

    def own(key: str) -> Any:
        return attributes.get(key, inherited.get(key))

    causality = element.get("causality", "local")
    variability = element.get("variability")
    if model.major == 1:
        causality = "local" if causality in ("internal", "none") else causality
        if variability == "parameter":
            causality, variability = "parameter", "fixed"
    start = attributes.get("start")
    if model.major == 3 and kind in ("String", "Binary"):
        starts = element.findall("Start")
        start = starts[0].get("value") if starts else None
    return Variable(
        index=index,
        line=element.sourceline or 0,
        name=element.get("name", ""),
        reference=integer(element.get("valueReference")),
        type=kind,
        causality=causality,
        variability=variability or _usual_variability(kind, causality, model.major),
        start=start,
        minimum=own("min"),
        maximum=own("max"),
        nominal=own("nominal"),
        unit=own("unit"),
        declared_type=declared,
        derivative=integer(attributes.get("derivative")),
        clocks=_numbers(element.get("clocks")) or (),
        dimensions=tuple(
            (integer(d.get("start")), integer(d.get("valueReference")))
            for d in (element.findall("Dimension") if model.major == 3 else ())
        ),
    )


def _usual_variability(kind: str, causality: str, major: int) -> str:
    if major < 3:
        return "continuous"
    if "arameter" in causality:
        return "fixed"
    return "continuous" if kind in _FLOATS else "discrete"


def _structure(root: Any, major: int) -> Iterator[Unknown]:
    roles = {2: _FMI2_ROLES, 3: _FMI3_ROLES}.get(major, {})
    for tag, role in roles.items():
        path = f"ModelStructure/{tag}/Unknown" if major == 2 else f"ModelStructure/{tag}"
        for element in root.findall(path):
            kinds = element.get("dependenciesKind")
            yield Unknown(
                role,
                element.sourceline or 0,
                integer(element.get("index" if major == 2 else "valueReference")),
                _numbers(element.get("dependencies")),
                None if kinds is None else tuple(kinds.split()),
            )


def _numbers(text: str | None) -> tuple[int, ...] | None:
    """Read a list of whole numbers; anything else becomes -1, which is never a reference."""
    if text is None:
        return None
    return tuple(-1 if (value := integer(word)) is None else value for word in text.split())
