"""From a scenario to what the master runs: FMUs found, links in nanoseconds, inputs driven."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.fmu import FmuDescription, Port, describe_fmu
from cosim.hinf import WorstCase
from cosim.master import Component, Endpoint, Link, System, make_timetable
from cosim.network import GilbertElliott, Jitter, PacketLink, TransportLink
from cosim.scenario.matching import endpoint, matched
from cosim.scenario.schema import ComponentPart, LinkPart, PacketPart, Scenario
from cosim.scenario.signals import Signals, along_path, pushed
from fmu_src.build import FLAVOUR, ensure_fmu
from fmu_src.catalogue import CATALOGUE


@dataclass(frozen=True)
class Hangar:
    """Where FMUs are found and built.

    Attributes
    ----------
    root : folder with FLAVOUR/NAME.fmu; what the catalogue has and is missing is built there.
    folder : where relative paths of a scenario begin.
    wanted : FMU reference -> SHA-256 that its file must have, wherever below `root` it lies
        and whatever it is called; if there is none, the reference is followed as usual.
    flavour : which FMUs a catalogue name means, a key of `fmu_src.build.FMI_VERSION`.
    """

    root: Path
    folder: Path
    wanted: Mapping[str, str] = field(default_factory=dict)
    flavour: str = FLAVOUR

    def find(self, fmu: str) -> FmuDescription:
        """An FMU by its hash if one is wanted, else by catalogue name or path."""
        if fmu in self.wanted:
            for path in sorted(self.root.rglob("*.fmu")):
                if hashlib.sha256(path.read_bytes()).hexdigest() == self.wanted[fmu]:
                    return describe_fmu(path)
        if fmu in CATALOGUE:
            try:
                return describe_fmu(ensure_fmu(fmu, self.root, flavour=self.flavour).path)
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
    push: WorstCase | None = None,
    at_rest: bool = False,
) -> System:
    """The system of a scenario.

    Parameters
    ----------
    fmus : by component.
    parameters : by component, on top of the scenario's own (the gain of a design).
    push : what the scenario's disturbance is, found from its design.
    at_rest : the companion run: from the zero state, the reference at zero, everything else
        the same; the gain from disturbance to output is defined there.

    Raises
    ------
    InputError : a connection that matches nothing, names that do not exist.
    """
    links = {name: link_of(name, part, scenario.run.seed) for name, part in scenario.links.items()}
    timetable = make_timetable(
        links,
        nanoseconds(scenario.run.step),
        nanoseconds(scenario.run.end),
        scenario.run.events,
    )
    connections = [
        connection
        for i, part in enumerate(scenario.connections)
        for connection in matched(fmus, endpoint(part.source), endpoint(part.target), part.link, i)
    ]
    driven: Signals = {}
    if scenario.reference is not None:
        goal = endpoint(scenario.reference.target).component
        if goal not in fmus:
            raise InputError.unknown("component", goal, fmus, where="reference.target")
        driven |= along_path(scenario.reference, timetable.points_ns / 1e9, at_rest=at_rest)
    if scenario.disturbance is not None and push is not None:
        signals = pushed(scenario.disturbance, push, fmus, timetable.points_ns / 1e9)
        for end in signals:
            if end in driven:
                raise InputError(
                    "an input has two sources",
                    where=str(end),
                    got="the disturbance, and the reference",
                )
        driven |= signals
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


def same_start(one: System, other: System) -> bool:
    """Whether two systems of one scenario are the same run, their inputs included."""
    return all(
        one.components[name].parameters.get(port.name, port.start)
        == other.components[name].parameters.get(port.name, port.start)
        for name, component in one.components.items()
        for port in component.description.ports.values()
    ) and all(np.array_equal(_values(one, end), _values(other, end)) for end in one.driven)


def _values(system: System, end: Endpoint) -> NDArray[np.float64]:
    """A driven input at the points that are known before the run."""
    signal = system.driven[end]
    return signal(system.timetable.points_ns / 1e9) if callable(signal) else signal


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


def link_of(name: str, part: LinkPart, seed: int) -> Link:
    """A link of a scenario in nanoseconds; `seed`: of the run, for one without its own."""
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
