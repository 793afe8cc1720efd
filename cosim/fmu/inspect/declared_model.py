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
_TRUE = ("true", "1")
_NAMED = {"log category": "LogCategories/Category", "annotation": "VendorAnnotations/Tool"}


@dataclass(slots=True)
class DeclaredVariable:
    """A variable as written in the XML; None for missing attributes.

    Attributes
    ----------
    index : its position, from 1.
    reference : value reference.
    attributes : all that are written, those of FMI 2's inner element among them.
    initial : as written, or else what the standard says for causality and variability; None: none.
    starts : the start values as written; None without a start.
    minimum, maximum, nominal, unit, display_unit : its own, or else its declared type's.
    derivative, previous : index in FMI 2, value reference in FMI 3.
    dimensions : one entry per dimension: (size, None) or (None, value reference).
    aliases : its further names in FMI 3: (name, display unit, description).
    inherited : the attributes of its declared type.
    """

    index: int
    line: int
    name: str
    reference: int | None
    type: str
    attributes: Mapping[str, str]
    causality: str
    variability: str
    initial: str | None
    starts: tuple[str, ...] | None
    minimum: str | None
    maximum: str | None
    nominal: str | None
    unit: str | None
    display_unit: str | None
    declared_type: str | None
    derivative: int | None
    previous: int | None
    clocks: tuple[int, ...] | None
    dimensions: tuple[tuple[int | None, int | None], ...]
    aliases: tuple[tuple[str, str | None, str | None], ...]
    inherited: Mapping[str, str]

    @property
    def real(self) -> bool:
        """Whether it is a floating-point variable."""
        return self.type in _FLOATS

    @property
    def names(self) -> tuple[str, ...]:
        """Its name, then those of its aliases."""
        return (self.name, *(name for name, *_ in self.aliases))

    @property
    def start(self) -> str | None:
        """Its start value, the first of several; None without one."""
        return self.starts[0] if self.starts else None

    def is_true(self, attribute: str) -> bool:
        """Whether a Boolean attribute is true."""
        return self.attributes.get(attribute) in _TRUE

    @property
    def where(self) -> str:
        """The place that a finding names."""
        return f"{XML}:{self.line} {self.name}"


@dataclass(slots=True)
class Unknown:
    """An entry of ModelStructure: its role, target and dependencies.

    `target` and `dependencies` are value references in FMI 3, else indices from 1. FMI 1 has
    dependencies at the outputs themselves (DirectDependency).
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
        return self.attributes.get(attribute) in _TRUE


@dataclass(slots=True)
class Unit:
    """A unit with the attributes of its BaseUnit, or None, and of each of its display units."""

    name: str
    line: int
    base: Mapping[str, str] | None
    displays: tuple[Mapping[str, str], ...] = ()

    @property
    def where(self) -> str:
        """The place that a finding names."""
        return f"{XML}:{self.line} unit {self.name}"


@dataclass(slots=True)
class DeclaredType:
    """A type of TypeDefinitions: the type of its variables, attributes, items (name, value)."""

    name: str
    line: int
    type: str
    attributes: Mapping[str, str]
    items: tuple[tuple[str, str], ...] = ()

    @property
    def where(self) -> str:
        """The place that a finding names."""
        return f"{XML}:{self.line} type {self.name}"


@dataclass(slots=True)
class DeclaredModel:
    """A model description.

    Attributes
    ----------
    types : every type as it is listed; `types_by_name` has the last of each name.
    named : tag -> names of log categories and of the annotations of tools.
    states : the continuous-time states, as ModelStructure numbers variables: those whose
        derivatives it lists.
    """

    version: str
    attributes: Mapping[str, str]
    interfaces: list[Interface] = field(default_factory=list)
    units: list[Unit] = field(default_factory=list)
    types: list[DeclaredType] = field(default_factory=list)
    types_by_name: dict[str, DeclaredType] = field(default_factory=dict)
    named: dict[str, list[str]] = field(default_factory=dict)
    variables: list[DeclaredVariable] = field(default_factory=list)
    structure: list[Unknown] = field(default_factory=list)
    states: frozenset[int] = frozenset()
    experiment: Mapping[str, str] = field(default_factory=dict)

    @property
    def major(self) -> int:
        """The major version of FMI: 1, 2 or 3."""
        return int(self.version[0])

    @property
    def token(self) -> str | None:
        """The guid, or instantiationToken in FMI 3."""
        return self.attributes.get("instantiationToken" if self.major == 3 else "guid")

    @property
    def kinds(self) -> frozenset[str]:
        """The kinds of use that it offers."""
        return frozenset(interface.kind for interface in self.interfaces)

    @property
    def experiment_times(self) -> dict[str, float]:
        """The finite numbers of the default experiment, by attribute."""
        return {
            key: value
            for key in ("startTime", "stopTime", "stepSize", "tolerance")
            if (value := number(self.experiment.get(key))) is not None and abs(value) < float("inf")
        }

    def variables_by_target(self) -> Mapping[int, DeclaredVariable]:
        """Return variables by number in ModelStructure: reference in FMI 3, else index."""
        if self.major < 3:
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
        displays = tuple(dict(display.attrib) for display in element.findall("DisplayUnit"))
        exponents = None if base is None else dict(base.attrib)
        model.units.append(Unit(name, element.sourceline, exponents, displays))
    model.types = list(_types(root, model.major))
    model.types_by_name = {each.name: each for each in model.types}
    for tag, path in _NAMED.items():
        model.named[tag] = [element.get("name", "") for element in root.findall(path)]
    places = root.find("ModelVariables")
    for element in [] if places is None else places.iterchildren(tag="*"):
        model.variables.append(_variable(element, len(model.variables) + 1, model))
    model.structure = list(_structure(root, model.major))
    by_target = model.variables_by_target()
    listed = (by_target.get(u.target or -1) for u in model.structure if u.role == "derivative")
    model.states = frozenset(v.derivative for v in listed if v and v.derivative is not None)
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


def _types(root: Any, major: int) -> Iterator[DeclaredType]:
    tag = {1: "Type", 2: "SimpleType", 3: "*"}[major]
    for element in root.findall(f"TypeDefinitions/{tag}"):
        inner = element if major == 3 else next(element.iterchildren(tag="*"), element)
        items = tuple(
            (item.get("name", ""), item.get("value", str(place)))
            for place, item in enumerate(inner.findall("Item"), 1)
        )
        kind = str(inner.tag).removesuffix("Type")
        name = element.get("name", "")
        yield DeclaredType(name, element.sourceline or 0, kind, dict(inner.attrib), items)


def _variable(element: Any, index: int, model: DeclaredModel) -> DeclaredVariable:
    value = element
    if model.major < 3:
        value = next((child for child in element.iterchildren(*_TYPES)), None)
    kind = "" if value is None else str(value.tag)
    attributes = {**element.attrib, **({} if value is None else value.attrib)}
    declared = model.types_by_name.get(attributes.get("declaredType", ""))
    inherited = {} if declared is None else declared.attributes

    def own(key: str) -> str | None:
        return attributes.get(key, inherited.get(key))

    causality = element.get("causality", "local")
    variability = element.get("variability")
    if model.major == 1:
        causality = "local" if causality in ("internal", "none") else causality
        if variability == "parameter" and causality != "output":  # without a start it is computed
            causality = "parameter" if "start" in attributes else "calculatedParameter"
        variability = "fixed" if variability == "parameter" else variability
    variability = variability or _usual_variability(kind, causality, model.major)
    start = attributes.get("start")
    starts = None if start is None else (start,)
    children = element.findall("Start") if model.major == 3 else []
    if kind in ("String", "Binary") and model.major == 3:
        values = [child.get("value") for child in children]
        starts = tuple(values) if values and None not in values else None
    elif start is not None and model.major == 3:
        starts = tuple(start.split())
    return DeclaredVariable(
        index=index,
        line=element.sourceline or 0,
        name=element.get("name", ""),
        reference=integer(element.get("valueReference")),
        type=kind,
        attributes=attributes,
        causality=causality,
        variability=variability,
        initial=_initial_of_fmi1(causality, variability, attributes)
        if model.major == 1
        else element.get("initial") or usual_initial(causality, variability, kind),
        starts=starts,
        minimum=own("min"),
        maximum=own("max"),
        nominal=own("nominal"),
        unit=own("unit"),
        display_unit=own("displayUnit"),
        declared_type=attributes.get("declaredType"),
        derivative=integer(attributes.get("derivative")),
        previous=integer(attributes.get("previous")),
        clocks=_numbers(element.get("clocks")),
        dimensions=tuple(
            (integer(d.get("start")), integer(d.get("valueReference")))
            for d in (element.findall("Dimension") if model.major == 3 else ())
        ),
        aliases=tuple(
            (a.get("name", ""), a.get("displayUnit"), a.get("description"))
            for a in element.findall("Alias")
        ),
        inherited=inherited,
    )


def _usual_variability(kind: str, causality: str, major: int) -> str:
    if major < 3:
        return "continuous"
    if "arameter" in causality:
        return "fixed"
    return "continuous" if kind in _FLOATS else "discrete"


def usual_initial(causality: str, variability: str, kind: str) -> str | None:
    """Return `initial` where it is not written (FMI 2.0.4, 2.2.7; FMI 3.0.2, 2.4.7.5)."""
    if causality == "independent" or kind == "Clock":
        return None
    exact = causality in ("parameter", "structuralParameter", "input") or variability == "constant"
    return "exact" if exact else "calculated"


def _initial_of_fmi1(causality: str, variability: str, attributes: Mapping[str, str]) -> str | None:
    """Return `initial` as FMI 1 says it: by a start, and whether it is fixed or a guess."""
    if variability == "constant" or causality == "input":
        return "exact"
    if "start" not in attributes:
        return "calculated"
    return "approx" if attributes.get("fixed") in ("false", "0") else "exact"


def _structure(root: Any, major: int) -> Iterator[Unknown]:
    if major == 1:
        yield from _dependencies_of_fmi1(root)
        return
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


def _dependencies_of_fmi1(root: Any) -> Iterator[Unknown]:
    """Give the outputs that say which inputs they depend on; -1 stands for a name that is none."""
    variables = root.findall("ModelVariables/ScalarVariable")
    indices = {element.get("name"): index for index, element in enumerate(variables, 1)}
    for index, element in enumerate(variables, 1):
        listed = element.find("DirectDependency")
        if listed is not None and element.get("causality") == "output":
            names = (name.text for name in listed.findall("Name"))
            numbers = tuple(indices.get(name, -1) for name in names)
            yield Unknown("output", listed.sourceline or 0, index, numbers, None)


def _numbers(text: str | None) -> tuple[int, ...] | None:
    """Read a list of whole numbers; anything else becomes -1, which is never a reference."""
    if text is None:
        return None
    return tuple(-1 if (value := integer(word)) is None else value for word in text.split())
