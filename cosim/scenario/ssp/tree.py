"""Read SystemStructure.ssd: nested systems, components, connections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lxml import etree

from cosim.fmu import UnitBase
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import (
    FMU_TYPE,
    LINEAR,
    LINK_ANNOTATION,
    LINK_FMU_ANNOTATION,
    NAMES_ANNOTATION,
    OMS,
    OSP,
    OWN,
    REST_ANNOTATION,
    RUN_ANNOTATION,
    SIGNALS_ANNOTATION,
    SSD,
    tag,
)
from cosim.scenario.ssp.ssp_parameters import BoundValue, bound_values, transformations
from cosim.scenario.ssp.ssp_units import units_in

MAX_DEPTH = 50


@dataclass(frozen=True)
class InnerConnection:
    """A connection inside one system; element None: a connector of the system itself.

    `linear` : factor and offset of its transformation.
    """

    source: tuple[str | None, str]
    target: tuple[str | None, str]
    link: str | None
    line: int
    converts: bool
    linear: tuple[float, float] = (1.0, 0.0)


@dataclass(frozen=True)
class Part:
    """A component and its FMU in the archive.

    `link` : name and TOML of the link, if this is a link FMU of this project.
    """

    name: str
    entry: str
    bound: Sequence[BoundValue]
    link: tuple[str, str] | None
    line: int


@dataclass(frozen=True)
class SubSystem:
    """A system with its components, nested systems and connections.

    `dictionaries` : element that refers to a signal dictionary -> what tells it from the others.
    """

    name: str
    parts: Sequence[Part]
    systems: Sequence[SubSystem]
    inner_connections: Sequence[InnerConnection]
    bound: Sequence[BoundValue]
    dictionaries: Mapping[str, str]


@dataclass(frozen=True)
class Description:
    """The whole description.

    Attributes
    ----------
    version : of SSP.
    links : TOML of annotated links.
    run : TOML of [run], or None.
    signals : TOML of paths and time series.
    players : elements of the outermost system that play them.
    rest : TOML of what SSP cannot express.
    start_s, stop_s, step_s : from the default experiment and other tools' annotations, or None.
    units : defined by the description.
    names : element of the outermost system -> name in the scenario, where they differ.
    """

    version: str
    name: str
    text: str
    system: SubSystem
    names: Mapping[str, str]
    links: dict[str, str]
    run: str | None
    signals: str
    players: tuple[str, ...]
    rest: str
    start_s: float | None
    stop_s: float | None
    step_s: float | None
    units: Mapping[str, UnitBase]


def read_description(archive: Archive) -> Description:
    """Read the archive's default system structure.

    Raises
    ------
    InputError : missing, invalid, or with essential parts that are not supported.
    """
    root = archive.xml(SSD, "SystemStructureDescription")
    system = root.find(tag("ssd", "System"))
    if system is None:
        raise archive.wrong("there is no System", SSD)
    archive.notes += [
        f"{other}: another variant of the system, left out"
        for other in archive.names()
        if other.endswith(".ssd") and other != SSD
    ]
    experiment = root.find(tag("ssd", "DefaultExperiment"))
    run = None
    start = stop = None
    if experiment is not None:
        start = _time(archive, experiment, "startTime")
        stop = _time(archive, experiment, "stopTime")
        runs = _own(experiment, RUN_ANNOTATION)
        run = runs[0].text if runs else None
    links = {e.get("name", ""): e.text or "" for e in _own(system, LINK_ANNOTATION)}
    names = "".join(e.text or "" for e in _own(system, NAMES_ANNOTATION))
    signals = _own(system, SIGNALS_ANNOTATION)
    rest = [*_own(root, REST_ANNOTATION), *_own(system, REST_ANNOTATION)]
    return Description(
        version=root.get("version", ""),
        name=root.get("name", ""),
        text=system.get("description") or root.get("description") or "",
        system=_system(archive, system, 0, {}),
        names=archive.toml("names", names),
        links=links,
        run=run,
        signals="".join(e.text or "" for e in signals),
        players=tuple(e.get("element") for e in signals if e.get("element")),
        rest="".join(e.text or "" for e in rest),
        start_s=start,
        stop_s=stop,
        step_s=_foreign_step(root),
        units=units_in(root),
    )


def _time(archive: Archive, experiment: Any, name: str) -> float | None:
    if experiment.get(name) is None:
        return None
    return archive.number(experiment, name, SSD, 0.0)


def _own(element: Any, kind: str) -> list[Any]:
    """Return the content of this project's annotations of an element."""
    path = f"{tag('ssd', 'Annotations')}/{tag('ssc', 'Annotation')}"
    holders = [a for a in element.findall(path) if a.get("type") == kind]
    return [part for a in holders for part in a if str(part.tag).startswith(f"{{{OWN}}}")]


def _foreign_step(root: Any) -> float | None:
    """Return the step that libcosim or OMSimulator would take."""
    for name, attribute in (
        (f"{{{OSP}}}FixedStepAlgorithm", "baseStepSize"),
        (f"{{{OMS}}}FixedStepMaster", "stepSize"),
    ):
        for found in root.iter(name):
            try:
                return float(found.get(attribute, ""))
            except ValueError:
                continue
    return None


def _system(archive: Archive, element: Any, depth: int, known: Mapping[str, str]) -> SubSystem:
    """Read a system; `known`: the signal dictionaries of those around it, by name."""
    name = element.get("name", "")
    if depth > MAX_DEPTH:
        raise archive.wrong("systems nested too deeply", _at(element), got=f"{depth} levels")
    known = {**known, **_own_dictionaries(element)}
    parts, systems, dictionaries = [], [], {}
    fmu_of = {e.get("element"): e for e in _own(element, LINK_FMU_ANNOTATION)}
    for child in _children(element, "Elements"):
        if child.tag == tag("ssd", "Component"):
            parts.append(_part(archive, child, fmu_of.get(child.get("name"))))
        elif child.tag == tag("ssd", "System"):
            systems.append(_system(archive, child, depth + 1, known))
        elif child.tag == tag("ssd", "SignalDictionaryReference"):
            of = child.get("dictionary", "")
            if of not in known:
                what = "a reference to an unknown signal dictionary"
                raise archive.wrong(
                    what, _at(child), expected=", ".join(sorted(known)) or "none", got=of
                )
            dictionaries[archive.needed(child, "name", SSD)] = known[of]
    names = [p.name for p in parts] + [s.name for s in systems] + list(dictionaries)
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise archive.wrong("two elements of one name", _at(element), got=", ".join(twice))
    inner_connections = [
        _inner_connection(archive, child)
        for child in _children(element, "Connections")
        if child.tag == tag("ssd", "Connection")
    ]
    bound = bound_values(archive, element, SSD)
    return SubSystem(name, parts, systems, inner_connections, bound, dictionaries)


def _own_dictionaries(element: Any) -> dict[str, str]:
    """Return the signal dictionaries that a system defines; value: distinct in the archive.

    What they say of their signals is not needed: the variables of the FMUs have types and units.
    """
    return {
        child.get("name", ""): f"signal dictionary {child.get('name')!r} (line {child.sourceline})"
        for child in _children(element, "SignalDictionaries")
    }


def _part(archive: Archive, element: Any, link_fmu: Any | None) -> Part:
    """Read a component; `link_fmu`: the annotation that says that it is a link FMU."""
    kind = element.get("type", FMU_TYPE)
    if kind != FMU_TYPE:
        raise archive.wrong(
            "a component that is not an FMU is not supported",
            _at(element),
            expected=FMU_TYPE,
            got=f"component {element.get('name')!r}: {kind}",
        )
    if element.get("implementation", "any") == "ModelExchange":
        raise archive.wrong(
            "a component for model exchange cannot be run",
            _at(element),
            expected="co-simulation",
            got=f"component {element.get('name')!r}",
        )
    if link_fmu is None:  # in older archives, the annotation is of the component
        link_fmu = next(iter(_own(element, LINK_FMU_ANNOTATION)), None)
    link = None if link_fmu is None else (link_fmu.get("name", ""), link_fmu.text or "")
    return Part(
        name=archive.needed(element, "name", SSD),
        entry=archive.entry(archive.needed(element, "source", SSD), SSD, _at(element)),
        bound=bound_values(archive, element, SSD),
        link=link,
        line=element.sourceline,
    )


def _inner_connection(archive: Archive, element: Any) -> InnerConnection:
    names = [
        (element.get(f"{side}Element"), archive.needed(element, f"{side}Connector", SSD))
        for side in ("start", "end")
    ]
    text = " -> ".join(".".join(n for n in pair if n) for pair in names)
    factor, offset = 1.0, 0.0
    for kind, *numbers in transformations(archive, element, SSD):
        if kind != LINEAR:
            raise archive.wrong(
                "a connection that transforms its values like this is not supported",
                _at(element),
                expected=LINEAR,
                got=f"{text}: {kind}",
                hint="put an FMU that transforms between the two",
            )
        factor, offset = numbers
    links = _own(element, LINK_ANNOTATION)
    return InnerConnection(
        names[0],
        names[1],
        links[0].get("name") if links else None,
        element.sourceline,
        element.get("suppressUnitConversion", "false") not in ("true", "1"),
        (factor, offset),
    )


def _children(element: Any, name: str) -> list[Any]:
    holder = element.find(tag("ssd", name))
    return [] if holder is None else list(holder.iterchildren(tag=etree.Element))


def _at(element: Any) -> str:
    return f"{SSD}:{element.sourceline}"
