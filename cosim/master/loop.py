"""The co-simulation loop (Jacobi, fixed or event-aligned points).

    for every communication point t_k:
        every component sends:    its outputs go into row k
        every component receives: its inputs are read off the rows that the links name
        every component steps from t_k to t_{k+1}, inputs held

An engine (`cosim.master.engine`) carries that out, a stretch of points at a time; between two
stretches the observers look at the rows that are there, and a run that has left its range ends.
How long a stretch is depends on the machine; nothing that is recorded depends on it.

The coupling delays what a component computes from its inputs until the next point; that
delay is the loop's own and is reported apart from the links'.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from contextlib import ExitStack

from cosim.fmu import FmuSlave
from cosim.master.engine import (
    Engine,
    EngineChoice,
    EngineName,
    Halt,
    build,
    choose,
    make_program,
)
from cosim.master.journal import Journal, Observer
from cosim.master.run import Ending, Run
from cosim.master.system import System
from cosim.master.wiring import Wiring, wire

_FATAL = 4
_STRETCH_S = 0.05
_LONGEST = 1 << 16


class _Pace:
    """How many points a stretch has: what takes about `_STRETCH_S`."""

    def __init__(self) -> None:
        self.points = 1

    def took(self, seconds: float) -> None:
        """Take note of how long the last stretch took."""
        share = min(8.0, _STRETCH_S / max(seconds, 1e-9))
        self.points = max(1, min(_LONGEST, int(self.points * share)))


def simulate(
    system: System, observers: Sequence[Observer] = (), *, engine: EngineName = "auto"
) -> Run:
    """Run a system from 0 to its end, or to where it diverges or fails.

    Parameters
    ----------
    engine : "python", "compiled", or "auto": compiled where it pays (`choose`).

    Raises
    ------
    InputError : a system that cannot be wired, a parameter that does not exist, an engine that
        is not installed.
    ComponentError : an FMU that cannot be loaded or initialised.
    """
    points = system.timetable.points_ns
    choice = choose(engine, points.size)
    wiring = wire(system)
    by_name = {s.name: s for s in wiring.stations}
    journal = Journal(observers)
    try:
        with ExitStack() as stack:
            for name, component in system.components.items():
                note = functools.partial(_note, journal, name)
                slave = stack.enter_context(FmuSlave(component.description, name, note))
                slave.initialise(component.parameters, 0.0, int(points[-1]) / 1e9)
                by_name[name].slave = slave
            for observer in observers:
                observer.begin(wiring.stations)
            carrier = build(choice.name, make_program(system, wiring))
            run = _loop(system, wiring, carrier, choice, journal)
    finally:
        journal.close()  # what slaves say while they end
    return run


def _note(journal: Journal, name: str, level: str, message: str, _category: str) -> None:
    journal.note(name, level, message)


def _loop(
    system: System, wiring: Wiring, engine: Engine, choice: EngineChoice, journal: Journal
) -> Run:
    points = system.timetable.points_ns

    def where() -> tuple[int, int]:
        k, complete = engine.where()
        return k + complete, int(points[k])

    journal.where = where
    pace = _Pace()
    complete = 0
    ending: Ending = "finished"
    reason: str | None = None
    while reason is None and complete < points.size:
        began = time.perf_counter()
        first, last = complete, min(complete + pace.points, points.size)
        halt = engine.advance(first, last)
        complete = last if halt is None else halt.complete
        if halt is not None:
            ending, reason = _halted(system, wiring, halt)
        # what is said in a step from a point out of range is void, like the step
        journal.hand_on(complete, said_after=halt is None or halt.what != "range")
        pace.took(time.perf_counter() - began)
    level, words = ("info", "the end is reached") if reason is None else ("error", reason)
    last_ns = int(points[halt.k if ending == "failed" and halt else max(complete - 1, 0)])
    journal.where = lambda: (complete, last_ns)
    journal.note("master", level, words)
    return Run(ending, reason, points[:complete], wiring.stations, choice)


def _halted(system: System, wiring: Wiring, halt: Halt) -> tuple[Ending, str]:
    """What ended a run, in words; a state beyond the range of numbers is no defect."""
    seconds = int(system.timetable.points_ns[halt.k]) / 1e9
    if halt.what == "range":
        out = f"{wiring.output(halt.station)} left the range of +-{system.divergence:g}"
        return "diverged", f"{out} at t = {seconds:g} s"
    at = "from" if halt.what == "step" else "at"
    slave = wiring.stations[halt.station].slave
    if halt.status == _FATAL:
        for station in wiring.stations:
            if station.slave.description.sha256 == slave.description.sha256:
                station.slave.abandon()
    error = slave.refused(f"{halt.what} {at} t = {seconds:g} s", halt.status)
    overflow = "no longer finite" in (error.got or "")
    return ("diverged" if overflow else "failed"), error.text()
