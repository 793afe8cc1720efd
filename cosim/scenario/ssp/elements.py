"""Make the elements and connections of an archive from the system that the master would run."""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import Port, build_fmu, own_folder
from cosim.fmu.export import ComponentSpec, component_module
from cosim.master import Connection, Endpoint, Session, System
from cosim.network import PacketLink, TransportLink
from cosim.scenario.ssp.link_fmu import link_spec, no_link_fmu
from cosim.scenario.ssp.names import SspVersion
from cosim.scenario.ssp.structure import TYPES, Connector, Element, Value, Wire, ssp_type

_TABLE = component_module("signal_table.variables")
_LINK = component_module("link_channel.variables")
_A_WIRE = "it delays nothing, and is a wire"
_STATE = {"age": "Real", "sequence": "Integer", "dropped": "Integer"}


class Resources:
    """FMUs below resources/ by their path in the archive, each once."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self._of: dict[str, str] = {}

    def add(self, stem: str, content: bytes) -> str:
        """Add an FMU unless it is already there; return its path."""
        digest = hashlib.sha256(content).hexdigest()
        if digest not in self._of:
            path, number = f"resources/{stem}.fmu", 2
            while path in self.files:
                path, number = f"resources/{stem}_{number}.fmu", number + 1
            self.files[path] = content
            self._of[digest] = path
        return self._of[digest]

    def build(self, spec: ComponentSpec) -> str:
        """Build and add a native FMU; an InputError where nothing is prebuilt and no compiler."""
        with tempfile.TemporaryDirectory(prefix="ssp-", dir=own_folder()) as folder:
            return self.add(spec.name, build_fmu(spec, Path(folder), "native").read_bytes())


@dataclass
class ArchiveElements:
    """The content of an archive.

    Attributes
    ----------
    annotated : TOML of the links that are annotations.
    element_of : link -> name of its element.
    signals : name of the element that plays paths, time series and disturbances, if one does.
    wired : transport links without delay, which are wires to other tools.
    """

    elements: list[Element] = field(default_factory=list)
    wires: list[Wire] = field(default_factory=list)
    annotated: dict[str, str] = field(default_factory=dict)
    element_of: dict[str, str] = field(default_factory=dict)
    signals: str | None = None
    wired: set[str] = field(default_factory=set)
    warnings: list[str] = field(default_factory=list)


def archive_elements(
    system: System,
    resources: Resources,
    links: Literal["annotate", "fmu"],
    tomls: Mapping[str, str],
    version: SspVersion,
) -> ArchiveElements:
    """Make elements of components, driven inputs and links; `tomls`: [links.NAME] by name.

    Raises
    ------
    InputError : something that SSP cannot express.
    """
    built = ArchiveElements()
    starts: dict[Endpoint, Value] = {}
    _drive(system, resources, built, starts)
    if links == "fmu":
        _link_fmus(system, resources, built, tomls)
    else:
        _annotations(system, built, tomls)
    _components(system, resources, built, starts, version)
    return built


def fold_maps(
    built: ArchiveElements, resources: Resources, maps: Mapping[str, tuple[float, float]]
) -> None:
    """Replace components that are a gain and an offset by transformations of connections.

    maps : gain and offset by name of the component.
    """
    for name, (gain, offset) in maps.items():
        into = [wire for wire in built.wires if wire.target[0] == name]
        out = [wire for wire in built.wires if wire.source[0] == name]
        if len(into) != 1 or any((wire.factor, wire.offset) != (1.0, 0.0) for wire in out):
            continue
        source = into[0].source
        built.wires = [
            replace(wire, source=source, factor=gain, offset=offset) if wire in out else wire
            for wire in built.wires
            if wire not in into
        ]
        built.elements = [element for element in built.elements if element.name != name]
    used = {element.source for element in built.elements}
    resources.files = {path: x for path, x in resources.files.items() if path in used}


def _components(
    system: System,
    resources: Resources,
    built: ArchiveElements,
    starts: Mapping[Endpoint, Value],
    version: SspVersion,
) -> None:
    connected = {end for wire in built.wires for end in (wire.source, wire.target)}
    own = []
    for name, component in system.components.items():
        fmu = component.description
        connectors = [
            _connector(port, name, version)
            for port in fmu.ports.values()
            if (name, port.name) in connected or _listed(port, version)
        ]
        values = {
            v: _value(fmu.ports[v], x, name, version) for v, x in component.parameters.items()
        }
        values |= {end.variable: v for end, v in starts.items() if end.component == name}
        source = resources.add(fmu.path.stem, fmu.path.read_bytes())
        own.append(Element(name, source, connectors, dict(sorted(values.items()))))
    built.elements[:0] = own


def _listed(port: Port, version: SspVersion) -> bool:
    """Whether an output without a connection is a connector: of a type that all tools take."""
    return (
        port.causality == "output"
        and not port.shape
        and port.kind in ("float", "int", "bool")
        and ssp_type(port, version) == TYPES[port.kind]
    )


def _connector(port: Port, component: str, version: SspVersion) -> Connector:
    _expressible(port, component, version)
    kind: Literal["input", "output"] = "output" if port.causality == "output" else "input"
    return Connector(port.name, kind, ssp_type(port, version), port.unit, port.shape)


def _value(port: Port, value: Any, component: str, version: SspVersion) -> Value:
    _expressible(port, component, version)
    if port.shape:
        value = np.asarray(value, dtype=object).ravel().tolist()
    return Value(ssp_type(port, version), value, port.unit, port.shape)


def _expressible(port: Port, component: str, version: SspVersion) -> None:
    if port.kind is None or (port.shape and version == "1.0"):
        raise InputError(
            f"SSP {version} has no connectors and no values for this variable",
            where=f"component {component!r}, {port.name}",
            expected="a scalar number, truth value or text",
            got="an array" if port.shape else "Binary or Clock",
            hint="`ssp` 2.0" if port.kind is not None else None,
        )


# ---- inputs that follow given signals


def _drive(
    system: System, resources: Resources, built: ArchiveElements, starts: dict[Endpoint, Value]
) -> None:
    """Constant signals become start values, the others a signal table FMU."""
    points = system.comm_schedule.points_ns
    moving: list[tuple[Endpoint, NDArray[np.float64], str | None]] = []
    for end, signal in system.driven.items():
        values = np.asarray(signal(points / 1e9) if callable(signal) else signal)
        port = system.components[end.component].description.ports[end.variable]
        if (values == values[0]).all():
            starts[end] = Value("Real", float(values[0]), port.unit)
        else:
            moving.append((end, values, port.unit))
    if not moving:
        return
    if points.size * len(moving) > _TABLE.MOST_NUMBERS:
        raise InputError(
            "the given signals are too long for a table in an FMU",
            where=", ".join(str(end) for end, _, _ in moving),
            expected=f"at most {_TABLE.MOST_NUMBERS} values",
            got=f"{points.size} points of {len(moving)} signals",
            hint="a shorter run, or a longer step",
        )
    name = built.signals = free_name("signals", system.components, system.links)
    outputs = [(str(end), unit) for end, _, unit in moving]
    rows = np.column_stack([values for _, values, _ in moving])
    spec = _TABLE.table_spec(
        "Signals", outputs, points.tolist(), rows.tolist(), system.comm_schedule.step_ns / 1e9
    )
    connectors = [Connector(n, "output", "Real", u) for n, u in outputs]
    built.elements.append(Element(name, resources.build(spec), connectors))
    built.wires += [Wire((name, str(end)), (end.component, end.variable)) for end, _, _ in moving]


def free_name(wanted: str, *taken: Iterable[str]) -> str:
    """Return `wanted`, with a number appended if that name is taken."""
    names = {name for group in taken for name in group}
    name, number = wanted, 2
    while name in names:
        name, number = f"{wanted}_{number}", number + 1
    return name


# ---- links as annotations


def _annotations(system: System, built: ArchiveElements, tomls: Mapping[str, str]) -> None:
    for connection in system.connections:
        _refuse_mode(system, connection)
        if system.is_state(connection.source):
            raise InputError(
                "the state of a link can be exported only if the link is an FMU",
                where=f"connection {connection.source} -> {connection.target}",
                hint="`links` fmu",
            )
        built.wires.append(Wire(connection.source, connection.target, connection.link))
    built.annotated = dict(tomls)
    used = sorted({c.link for c in system.connections if c.link is not None})
    if used:
        built.warnings.append(
            f"other tools ignore the links {', '.join(used)} and connect directly; "
            "cosim ssp export --links fmu makes each an FMU, which they run"
        )


# ---- links as FMUs


def _link_fmus(
    system: System, resources: Resources, built: ArchiveElements, tomls: Mapping[str, str]
) -> None:
    _keep_others(system, built, tomls)
    over: dict[str, list[Connection]] = {}
    for connection in system.connections:
        name = connection.link
        if name is None or name in built.annotated:
            built.wires.append(_plain(system, connection))
        else:
            over.setdefault(name, []).append(connection)
    firsts = _first_values(system, over)
    for name, connections in over.items():
        element = free_name(name, system.components, [e.name for e in built.elements])
        built.element_of[name] = element
        _link_fmu(system, resources, built, (name, element), connections, firsts, tomls[name])
    for i, wire in enumerate(built.wires):
        sender, state = wire.source
        if state not in _STATE:
            continue
        if sender in built.element_of:
            built.wires[i] = Wire((built.element_of[sender], state), wire.target)
        elif sender in system.links:
            raise InputError(
                "the state of a link can be exported only if the link is an FMU",
                where=f"connection {'.'.join(wire.source)} -> {'.'.join(wire.target)}",
                got=f"link {sender!r}: {_why_no_fmu(system, sender)}",
            )


def _keep_others(system: System, built: ArchiveElements, tomls: Mapping[str, str]) -> None:
    """Annotate the links that are no FMUs, so that an import has all of them again."""
    for name in system.links:
        why = _why_no_fmu(system, name)
        if why is None:
            continue
        built.annotated[name] = tomls[name]
        if why == _A_WIRE:
            built.wired.add(name)
        else:
            built.warnings.append(f"link {name!r} is an annotation and no FMU: {why}")


def _why_no_fmu(system: System, name: str) -> str | None:
    """Return why a link is no FMU, in words; None: it is one."""
    link = system.links[name]
    if isinstance(link, TransportLink) and link.delay is None and link.delay_ns == 0:
        return _A_WIRE
    if all(connection.link != name for connection in system.connections):
        return "nothing is connected over it"
    why = no_link_fmu(link)
    return None if why is None else f"{why}; other tools connect directly"


def _refuse_mode(system: System, connection: Connection) -> None:
    if connection.source.component in system.modes:
        raise InputError(
            "the mode of a machine cannot be exported: SSP has no mode machines",
            where=f"connection {connection.source} -> {connection.target}",
            expected="a connection from an output",
            hint="set the input by enter of the states, or by events",
        )


def _plain(system: System, connection: Connection) -> Wire:
    source, target = connection.source, connection.target
    _refuse_mode(system, connection)
    if system.is_state(source):
        kind = system.components[target.component].description.ports[target.variable].kind
        wanted = _STATE.get(source.variable)
        if wanted is None or TYPES[kind] != wanted:
            raise InputError(
                "a link FMU has no such output",
                where=f"connection {source} -> {target}",
                expected=", ".join(f"{n} ({t})" for n, t in _STATE.items()),
                got=f"{source.variable}, to an input of type {TYPES[kind]}",
            )
    return Wire(source, target, connection.link)


def _first_values(system: System, over: Mapping[str, list[Connection]]) -> dict[Endpoint, float]:
    """Return what transport links deliver at the start: the first outputs of the senders."""
    sources = {
        c.source
        for name, connections in over.items()
        if not isinstance(system.links[name], PacketLink)
        for c in connections
    }
    if not sources:
        return {}
    with Session(system, engine="python") as session:
        return {end: float(session.value(end.component, end.variable)) for end in sources}


def _link_fmu(
    system: System,
    resources: Resources,
    built: ArchiveElements,
    names: tuple[str, str],
    connections: list[Connection],
    firsts: Mapping[Endpoint, float],
    toml: str,
) -> None:
    name, element = names
    signals, connectors = [], []
    for i, connection in enumerate(connections, 1):
        source, target = connection.source, connection.target
        sender = system.components[source.component].description.ports[source.variable]
        component = system.components[target.component]
        receiver = component.description.ports[target.variable]
        if sender.kind != "float" or receiver.kind != "float" or sender.shape or receiver.shape:
            raise InputError(
                "a link FMU carries Reals only",
                where=f"connection {source} -> {target}, link {name!r}",
                got=f"{sender.getter_type} to {receiver.getter_type}"
                + (", an array" if sender.shape or receiver.shape else ""),
            )
        start = component.start_of(target.variable)
        first = firsts.get(source, 0.0 if start is None else float(start))
        signals.append(_LINK.LinkSignal(sender.unit, first, f"{source} to {target}"))
        built.wires.append(Wire(source, (element, f"u[{i}]")))
        built.wires.append(Wire((element, f"y[{i}]"), target))
        connectors.append(Connector(f"u[{i}]", "input", "Real", sender.unit))
        connectors.append(Connector(f"y[{i}]", "output", "Real", sender.unit))
    link = system.links[name]
    model = "Link_" + re.sub(r"[^A-Za-z0-9]+", "_", name)
    spec, warnings = link_spec(model[:80], link, signals, system.comm_schedule.step_ns)
    built.warnings += warnings
    connectors.append(Connector("age", "output", "Real", "s"))
    if isinstance(link, PacketLink):
        connectors += [Connector(n, "output", "Integer") for n in ("sequence", "dropped")]
    connectors.sort(key=lambda c: c.kind)
    built.elements.append(Element(element, resources.build(spec), connectors, link=(name, toml)))
