"""The parts of a system, unchecked: components, connections, links and schedule."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import Feedthrough, FmuDescription, Port
from cosim.master.communication_schedule import CommunicationSchedule, Link
from cosim.master.event_checks import Ticks, check_event_keys
from cosim.network import distance

LogLevel = Literal["debug", "info", "warning", "error", "fatal"]
"""Levels of log messages, the least grave first."""

Algorithm = Literal["jacobi", "gauss-seidel"]
"""How components step: side by side, or one after the other."""

UnknownFeedthrough = Literal["refuse", "previous"]
"""What is done about algebraic loops through outputs that do not declare their dependencies."""
Policy = Literal["hold", "midpoint", "linear", "previous"]
"""Value of an input during a step: see `cosim.master.routes`."""


class Endpoint(NamedTuple):
    """A variable of a component."""

    component: str
    variable: str

    def __str__(self) -> str:
        return f"{self.component}.{self.variable}"


class Connection(NamedTuple):
    """An output connected to an input, directly or over a link."""

    source: Endpoint
    target: Endpoint
    link: str | None = None
    policy: Policy = "hold"


@dataclass(frozen=True)
class Component:
    """An FMU with its start parameters.

    `every_ns` : its own communication step [ns]; None: it communicates at every point.
    `log_level` : messages below this level ("debug" ... "fatal") are left out;
    `log_categories` : those of the FMU's categories that are logged; None: all.
    `feedthrough` : the outputs with direct feedthrough, in place of what the FMU declares:
    "none", or their names (`cosim.fmu.feedthrough`); None: as the FMU declares.
    `isolate` : its slave is in a process of its own (`cosim.fmu.isolation`).
    `event_mode` : its events and Clocks are handled in event mode; None: if its FMU has one.
    `clocks` : by name of an input Clock, its interval [s], or the instants of its ticks [s].
    `intermediate` : outputs that are also read within its steps, where the FMU offers it.
    Arrays have the lengths that structural parameters among `parameters` give them.

    Raises
    ------
    InputError : a length that is none, a name in `feedthrough` that is no output, an event mode
        that the FMU does not have, a Clock or an output that cannot be used like this.
    """

    description: FmuDescription
    parameters: Mapping[str, Any] = field(default_factory=dict)
    every_ns: int | None = None
    log_level: LogLevel = "debug"
    log_categories: Sequence[str] | None = None
    feedthrough: Feedthrough | None = None
    isolate: bool = False
    event_mode: bool | None = None
    clocks: Mapping[str, Ticks] = field(default_factory=dict)
    intermediate: Sequence[str] = ()

    def __post_init__(self) -> None:
        resized = self.description.resized(self.parameters)
        check_event_keys(resized, self.event_mode, self.clocks, self.intermediate)
        described = resized if self.has_events else resized.without_events()
        object.__setattr__(self, "description", described.with_feedthrough(self.feedthrough))

    @property
    def has_events(self) -> bool:
        """Whether its events and Clocks are handled in event mode."""
        return self.description.has_event_mode if self.event_mode is None else self.event_mode

    def start_of(self, name: str, otherwise: Any = None) -> Any:
        """Return the start value of a variable: its parameter, or else what the FMU declares.

        otherwise : where there is no such variable, or nothing is declared.
        """
        port = self.description.ports.get(name)
        declared = otherwise if port is None or port.start is None else port.start
        return self.parameters.get(name, declared)


class RouteKey(NamedTuple):
    """What connections of one route have in common."""

    source: str
    link: str | None
    policy: Policy

    def __str__(self) -> str:
        return f"from {self.source}" + (f" over {self.link}" if self.link else "")


class DelaySource(NamedTuple):
    """The signals that decide the delay of a link with a `DelaySignal`.

    signals : outputs of components without direct feedthrough.
    origin : None: the value is that of the one signal. Else it is the distance of the signals
        from this place, each coordinate of which is a number or such an output too.
    """

    signals: tuple[Endpoint, ...]
    origin: tuple[float | Endpoint, ...] | None = None

    @property
    def read(self) -> tuple[Endpoint, ...]:
        """All signals that are read: those of the position, then those of the origin."""
        return (*self.signals, *(x for x in self.origin or () if isinstance(x, Endpoint)))

    def value(self, values: Sequence[float]) -> float:
        """Return the value that decides the delay, of the values of `read`: or the distance."""
        if self.origin is None:
            return values[0]
        moving = iter(values[len(self.signals) :])
        origin = [next(moving) if isinstance(x, Endpoint) else x for x in self.origin]
        return distance(values[: len(self.signals)], origin)


class PositionSource(NamedTuple):
    """The signals that the places of a medium's nodes follow, in the order of its coordinates.

    signals : outputs of components without direct feedthrough.
    """

    signals: tuple[Endpoint, ...]

    @property
    def read(self) -> tuple[Endpoint, ...]:
        """All signals that are read."""
        return self.signals

    def value(self, values: Sequence[float]) -> tuple[float, ...]:
        """Return the coordinates, of the values of `read`."""
        return tuple(values)


Signal = NDArray[np.float64] | Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Values at the points, or a function of the points [s]."""


class Modes(NamedTuple):
    """The states of a mode machine, and the number of the one it begins in, from 0.

    Connections may lead from `MACHINE.number` and from `MACHINE.STATE`, 1 in that state and 0 else.
    """

    states: tuple[str, ...]
    initial: int = 0


MODE_NUMBER: Final = "number"
"""The number of the state that a mode machine is in, as a source of connections."""


@dataclass(frozen=True)
class Parts:
    """The fields of a `System`, described there, and properties derived from them."""

    components: Mapping[str, Component]
    connections: Sequence[Connection]
    links: Mapping[str, Link]
    driven: Mapping[Endpoint, Signal]
    comm_schedule: CommunicationSchedule
    divergence: float | None = None
    algorithm: Algorithm = "jacobi"
    order: Sequence[str] | None = None
    delays: Mapping[str, DelaySource | PositionSource] = field(default_factory=dict)
    threads: int = 1
    unknown_feedthrough: UnknownFeedthrough = "refuse"
    solve: bool = False
    solve_tolerance: float = 1e-10
    solve_limit: int = 100
    modes: Mapping[str, Modes] = field(default_factory=dict)

    @property
    def has_events(self) -> bool:
        """Whether components have events: points are added during the run, where they occur."""
        return any(component.has_events for component in self.components.values())

    @property
    def grows(self) -> bool:
        """Whether points are added during the run."""
        return self.comm_schedule.grows

    def is_state(self, end: Endpoint) -> bool:
        """Whether an endpoint is the state of a link or of a mode machine."""
        known = end.component in self.links or end.component in self.modes
        return known and end.component not in self.components

    def port(self, end: Endpoint) -> Port:
        """Return the variable of an endpoint; `InputError` if there is none."""
        component = self.components.get(end.component)
        if component is None:
            raise InputError.unknown("component", end.component, self.components)
        port = component.description.ports.get(end.variable)
        if port is None:
            return component.description.port(end.variable, where=f"component {end.component!r}")
        return port
