"""From a scenario to what the master runs: FMUs found, links in nanoseconds, inputs driven."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.fmu import FmuDescription, Port, describe_fmu
from cosim.master import Component, Connection, Endpoint, Link, System, make_timetable
from cosim.network import GilbertElliott, Jitter, PacketLink, TransportLink
from cosim.scenario.schema import ComponentPart, LinkPart, PacketPart, PathPart, Scenario
from fmu_src.build import ensure_fmu
from fmu_src.catalogue import CATALOGUE


@dataclass(frozen=True)
class Hangar:
    """Where FMUs are found and built.

    Attributes
    ----------
    root : folder with python/NAME.fmu; what the catalogue has and is missing is built there.
    folder : where relative paths of a scenario begin.
    wanted : FMU reference -> SHA-256 that its file must have, wherever below `root` it lies
        and whatever it is called; if there is none, the reference is followed as usual.
    """

    root: Path
    folder: Path
    wanted: Mapping[str, str] = field(default_factory=dict)

    def find(self, fmu: str) -> FmuDescription:
        """An FMU by its hash if one is wanted, else by catalogue name or path."""
        if fmu in self.wanted:
            for path in sorted(self.root.rglob("*.fmu")):
                if hashlib.sha256(path.read_bytes()).hexdigest() == self.wanted[fmu]:
                    return describe_fmu(path)
        if fmu in CATALOGUE:
            try:
                return describe_fmu(ensure_fmu(fmu, self.root).path)
            except OSError as error:
                raise InputError(
                    f"the FMU {fmu} cannot be built",
                    where=str(self.root),
                    expected="a folder that can be written",
                    got=str(error),
                    hint="another folder: --fmus",
                ) from error
        if not fmu.endswith(".fmu"):
            raise InputError.unknown("FMU", fmu, CATALOGUE, where="components")
        path = Path(fmu)
        return describe_fmu(path if path.is_absolute() else self.folder / path)


def nanoseconds(seconds: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(seconds * 1e9)


def find_fmus(scenario: Scenario, hangar: Hangar) -> dict[str, FmuDescription]:
    """The FMU of every component, built if the catalogue has it and it is missing."""
    return {name: hangar.find(part.fmu) for name, part in scenario.components.items()}


def assemble(
    scenario: Scenario,
    fmus: Mapping[str, FmuDescription],
    *,
    parameters: Mapping[str, Mapping[str, float]],
    at_rest: bool = False,
) -> System:
    """The system of a scenario.

    Parameters
    ----------
    fmus : by component.
    parameters : by component, on top of the scenario's own (the gain of a design).
    at_rest : the companion run: from the zero state, the reference at zero, everything else
        the same; the gain from disturbance to output is defined there.

    Raises
    ------
    InputError : a connection that matches nothing, names that do not exist.
    """
    links = {name: _link(name, part, scenario.run.seed) for name, part in scenario.links.items()}
    timetable = make_timetable(
        links,
        nanoseconds(scenario.run.step),
        nanoseconds(scenario.run.end),
        scenario.run.events,
    )
    connections = [
        connection
        for i, part in enumerate(scenario.connections)
        for connection in _matched(
            fmus, _endpoint(part.source), _endpoint(part.target), part.link, i
        )
    ]
    driven = {}
    if scenario.reference is not None:
        goal = _endpoint(scenario.reference.target).component
        if goal not in fmus:
            raise InputError.unknown("component", goal, fmus, where="reference.target")
        driven = _driven(scenario.reference, timetable.points_ns / 1e9, at_rest=at_rest)
    reached = {c.target for c in connections} | set(driven)
    components = {}
    for name, part in scenario.components.items():
        own = _own(part)
        if at_rest:
            own |= {
                p.name: 0.0
                for p in fmus[name].ports.values()
                if _of_the_start(p, Endpoint(name, p.name) in reached)
            }
        components[name] = Component(fmus[name], {**own, **parameters.get(name, {})})
    return System(components, connections, links, driven, timetable, scenario.run.divergence)


def _of_the_start(port: Port, reached: bool) -> bool:  # noqa: FBT001 - a predicate of both
    """Whether a variable says where a run starts.

    That is an initial state, or an input until something reaches it; the start value of an
    input that nothing reaches holds for the whole run.
    """
    if port.causality == "parameter":
        return port.name.startswith("initial.")
    return reached and port.causality == "input" and port.kind == "float"


def _own(part: ComponentPart) -> dict[str, float]:
    return {name: float(value) for name, value in part.parameters.items()}


def _endpoint(text: str) -> Endpoint:
    component, _, variable = text.partition(".")
    return Endpoint(component, variable)


def _link(name: str, part: LinkPart, seed: int) -> Link:
    if not isinstance(part, PacketPart):
        return TransportLink(name, nanoseconds(part.delay))
    jitter = Jitter()
    if part.jitter is not None:
        jitter = Jitter(
            kind=part.jitter.kind,
            width_ns=nanoseconds(part.jitter.width),
            mean_ns=nanoseconds(part.jitter.mean),
            sigma_ns=nanoseconds(part.jitter.sigma),
            max_ns=None if part.jitter.max is None else nanoseconds(part.jitter.max),
        )
    loss: float | GilbertElliott
    if isinstance(part.loss, float):
        loss = part.loss
    else:
        loss = GilbertElliott(
            part.loss.p_enter, part.loss.p_exit, part.loss.loss_good, part.loss.loss_bad
        )
    return PacketLink(
        name=name,
        sample_time_ns=nanoseconds(part.sample_time),
        offset_ns=nanoseconds(part.offset),
        delay_ns=nanoseconds(part.delay),
        jitter=jitter,
        loss=loss,
        order=part.order,
        on_loss=part.on_loss,
        quantization=part.quantization,
        data_rate=part.data_rate,
        frame_size=part.frame_size,
        seed=seed if part.seed is None else part.seed,
    )


def _matched(
    fmus: Mapping[str, FmuDescription],
    source: Endpoint,
    target: Endpoint,
    link: str | None,
    number: int,
) -> list[Connection]:
    """One connection per variable: the names themselves, or two groups with equal endings."""
    where = f"connections[{number}], {source} -> {target}"
    for end in (source, target):
        if end.component not in fmus:
            raise InputError.unknown("component", end.component, fmus, where=where)
    sources = _members(fmus[source.component], source.variable, "output")
    targets = _members(fmus[target.component], target.variable, "input")
    if "" in sources and "" in targets:
        return [Connection(source, target, link)]
    common = [ending for ending in sources if ending in targets and ending]
    if not common:
        for end, kind, found in ((source, "output", sources), (target, "input", targets)):
            if not found:
                ports = [p.name for p in fmus[end.component].ports.values() if p.causality == kind]
                raise InputError.unknown(
                    kind, end.variable, ports, where=f"{where}: component {end.component!r}"
                )
    if not common or set(sources) != set(targets):
        raise InputError(
            "the two groups do not have the same members",
            where=where,
            expected=f"{source}: {', '.join(sources) or 'none'}",
            got=f"{target}: {', '.join(targets) or 'none'}",
            hint="connect the variables one by one",
        )
    return [
        Connection(
            Endpoint(source.component, source.variable + ending),
            Endpoint(target.component, target.variable + ending),
            link,
        )
        for ending in common
    ]


def _members(
    fmu: FmuDescription, name: str, causality: Literal["output", "input"]
) -> dict[str, str]:
    """Ending -> variable: "" for the variable itself, ".x" or "[1]" for members of a group."""
    found = {}
    for port in fmu.ports.values():
        ending = port.name[len(name) :]
        if (
            port.causality == causality
            and port.name.startswith(name)
            and ending[:1] in ("", ".", "[")
        ):
            found[ending] = port.name
    return found


def _driven(
    path: PathPart, seconds: NDArray[np.float64], *, at_rest: bool
) -> dict[Endpoint, NDArray[np.float64]]:
    points = np.array(path.points)
    base = _endpoint(path.target)
    driven = {}
    for j, axis in enumerate(path.axes):
        values = (
            np.zeros(seconds.size) if at_rest else _along(points, j, seconds, path.interpolation)
        )
        driven[Endpoint(base.component, f"{base.variable}.{axis}")] = values
    return driven


def _along(
    points: NDArray[np.float64], axis: int, seconds: NDArray[np.float64], interpolation: str
) -> NDArray[np.float64]:
    times, values = points[:, 0], points[:, 1 + axis]
    if times.size == 1:
        return np.full(seconds.size, values[0])
    place = np.clip(np.searchsorted(times, seconds, side="right") - 1, 0, times.size - 2)
    share = np.clip((seconds - times[place]) / (times[place + 1] - times[place]), 0.0, 1.0)
    if interpolation == "smooth":
        share = share * share * (3.0 - 2.0 * share)
    along: NDArray[np.float64] = values[place] + share * (values[place + 1] - values[place])
    return along
