"""The co-simulation loop (Jacobi, fixed or event-aligned points).

    for every communication point t_k:
        every component sends:    its outputs go into row k
        every component receives: its inputs are read off the rows that the links name
        the observer looks
        every component steps from t_k to t_{k+1}, inputs held

The coupling delays what a component computes from its inputs until the next point; that
delay is the loop's own and is reported apart from the links'.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ComponentError, InputError
from cosim.fmu import FmuSlave
from cosim.master.system import Endpoint, System
from cosim.master.wiring import Station, wire

Ending = Literal["finished", "diverged", "failed"]


class Observer(Protocol):
    """Looks on while a run goes."""

    def begin(self, stations: Sequence[Station]) -> None:
        """Before the first point, all slaves initialised."""

    def point(self, k: int) -> None:
        """Row k of every station is complete."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """A component, or the loop, has said something."""


@dataclass(frozen=True)
class Run:
    """What happened.

    Attributes
    ----------
    ending : "finished" at the end; "diverged" when an output left the allowed range or
        the numbers; "failed" when a component refused for another reason.
    reason : in words, None when finished.
    points_ns : the points reached [ns], int64 (k,).
    stations : the rows, of which the first k are valid.
    """

    ending: Ending
    reason: str | None
    points_ns: NDArray[np.int64]
    stations: tuple[Station, ...]

    def signal(self, component: str, variable: str) -> NDArray[np.float64]:
        """Values of an output or a connected input at the points reached, shape (k,).

        Raises
        ------
        InputError : no such component, or the variable was not part of the run.
        """
        names = {s.name: s for s in self.stations}
        station = names.get(component)
        if station is None:
            raise InputError.unknown("component", component, names)
        reached = self.points_ns.size
        for ports, rows in (
            (station.output_ports, station.outputs),
            (station.input_ports, station.inputs),
        ):
            for j, port in enumerate(ports):
                if port.name == variable:
                    return rows[:reached, j]
        known = [p.name for p in (*station.output_ports, *station.input_ports)]
        raise InputError.unknown("signal", variable, known, where=f"component {component!r}")


def simulate(system: System, observers: Sequence[Observer] = ()) -> Run:
    """Run a system from 0 to its end, or to where it diverges or fails.

    Raises
    ------
    InputError : a system that cannot be wired, a parameter that does not exist.
    ComponentError : an FMU that cannot be loaded or initialised.
    """
    stations = wire(system)
    by_name = {s.name: s for s in stations}
    clock = _Clock(system.timetable.points_ns)
    with ExitStack() as stack:
        for name, component in system.components.items():

            def log(level: str, message: str, name: str = name) -> None:
                for observer in observers:
                    observer.log(clock.now_ns, level, name, message)

            slave = stack.enter_context(FmuSlave(component.description, name, log))
            slave.initialise(component.parameters, 0.0, clock.end_s)
            by_name[name].attach(slave)
        for observer in observers:
            observer.begin(stations)
        return _loop(system, stations, clock, observers)


class _Clock:
    """Integer time: a point is read off the timetable, never accumulated."""

    def __init__(self, points_ns: NDArray[np.int64]) -> None:
        self.points_ns = points_ns
        self.seconds = [int(t) / 1e9 for t in points_ns]
        self.end_s = self.seconds[-1]
        self.now_ns = 0


def _loop(  # noqa: C901 - the algorithm, in one place
    system: System, stations: Sequence[Station], clock: _Clock, observers: Sequence[Observer]
) -> Run:
    in_step_order = [s for name in system.components for s in stations if s.name == name]
    last = len(clock.seconds) - 1
    complete = 0  # rows: one that a component broke off counts no more than one never begun

    def ended(ending: Ending, reason: str | None, reached: int) -> Run:
        level, words = ("info", "the end is reached") if reason is None else ("error", reason)
        for observer in observers:
            observer.log(clock.now_ns, level, "master", words)
        return Run(ending, reason, clock.points_ns[:reached], tuple(stations))

    try:
        for k in range(last + 1):
            clock.now_ns = int(clock.points_ns[k])
            for station in stations:
                station.send(k)
            for station in stations:
                station.receive(k)
            complete = k + 1
            for observer in observers:
                observer.point(k)
            beyond = _beyond(stations, k, system.divergence)
            if beyond is not None:
                why = f"{beyond} left the range of +-{system.divergence:g}"
                return ended("diverged", f"{why} at t = {clock.seconds[k]:g} s", complete)
            if k < last:
                now = clock.seconds[k]
                size = (int(clock.points_ns[k + 1]) - clock.now_ns) / 1e9
                for station in in_step_order:
                    station.slave.step(now, size)
    except ComponentError as error:
        # a state beyond the range of numbers is the end of a divergence, not a defect
        overflow = "no longer finite" in (error.got or "")
        return ended("diverged" if overflow else "failed", error.text(), complete)
    return ended("finished", None, complete)


def _beyond(stations: Sequence[Station], k: int, bound: float) -> Endpoint | None:
    for station in stations:
        row = station.outputs[k]
        if row.size and not np.abs(row).max() <= bound:  # also true for NaN
            worst = int(np.argmax(~(np.abs(row) <= bound)))
            return Endpoint(station.name, station.output_ports[worst].name)
    return None
