"""Run one FMU and tell what happens; `run` starts this in a process of its own.

Each event is told at once, so that the last one shows where the FMU ended the process. No other
process loads the FMU.
"""

from __future__ import annotations

import ctypes
import math
import os
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import fmpy
import msgspec
from fmpy import fmi1, fmi2, fmi3
from fmpy.logging import addLoggerProxy

from cosim.core import Frames
from cosim.fmu.fmi1_calls import FMU1Calls

_LEVELS = ("info", "warning", "warning", "error", "fatal", "info")
_MOST_MESSAGES = 50


class Event(msgspec.Struct, kw_only=True, omit_defaults=True):
    """What happens; what is None does not.

    Attributes
    ----------
    stage : of the run, which begins if there is nothing else.
    refused, broken : a call that was refused, or raised an exception.
    log, text : level and text of a message of the FMU.
    steps, t, finite : how many steps were taken, to which time [s], with finite outputs.
    differs : after what the outputs are not what they were before.
    start, described, got : name of a parameter, its described and its real start value.
    end : the run is over.
    """

    stage: str | None = None
    refused: str | None = None
    broken: str | None = None
    log: str | None = None
    text: str = ""
    steps: int | None = None
    t: float = 0.0
    finite: bool = True
    differs: str | None = None
    start: str | None = None
    described: float = 0.0
    got: str = ""
    end: bool = False

    @property
    def begins_stage(self) -> bool:
        """Whether a stage begins with it."""
        others = self.refused, self.broken, self.log
        return self.stage is not None and all(other is None for other in others)


class EventLog:
    """The events of a run, told as they happen."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._messages = 0
        self.stage = ""

    def write(self, **event: Any) -> None:
        """Tell an event; its parts are those of `Event`."""
        with suppress(OSError):  # the process that listens will say so
            self._frames.send(Event(**event))

    def enter(self, stage: str) -> None:
        """Record the stage that begins."""
        self.stage = stage
        self.write(stage=stage)

    def log(self, level: int, text: bytes | None) -> None:
        """Record a message of the FMU, up to a number of messages."""
        self._messages += 1
        if self._messages <= _MOST_MESSAGES:
            name = _LEVELS[level] if 0 <= level < len(_LEVELS) else "error"
            message = (text or b"").decode("utf-8", "replace").strip()
            self.write(log=name, text=message[:2000], stage=self.stage)


class Driver:
    """An FMU of any version and kind, behind one set of calls."""

    def __init__(self, request: dict[str, Any], folder: str, event_log: EventLog) -> None:
        self.request = request
        self.event_log = event_log
        self.major, self.kind = request["major"], request["kind"]
        classes = {
            (1, "co-simulation"): FMU1Calls,
            (1, "model exchange"): fmi1.FMU1Model,
            (2, "co-simulation"): fmi2.FMU2Slave,
            (2, "model exchange"): fmi2.FMU2Model,
            (3, "co-simulation"): fmi3.FMU3Slave,
            (3, "model exchange"): fmi3.FMU3Model,
            (3, "scheduled execution"): fmi3.FMU3ScheduledExecution,
        }
        self.fmu: Any = classes[self.major, self.kind](
            guid=request["token"],
            unzipDirectory=folder,
            modelIdentifier=request["identifier"],
            instanceName="probe",
            libraryPath=request["library"],
            requireFunctions=False,
        )
        self.t = request["start"]

    @property
    def continuous(self) -> bool:
        """Whether this process integrates the states."""
        return bool(self.kind == "model exchange")

    def instantiate(self) -> None:
        """Create the instance; its messages go to the event log."""
        if self.major == 3:
            self.fmu.instantiate(loggingOn=True, logMessage=self._log)
            return
        module, prefix = (fmi2, "fmi2") if self.major == 2 else (fmi1, "fmi1")
        logger = getattr(module, f"{prefix}CallbackLoggerTYPE")
        callbacks = getattr(module, f"{prefix}CallbackFunctions")()
        callbacks.logger = logger(self._log)
        allocate = getattr(module, f"{prefix}CallbackAllocateMemoryTYPE")
        callbacks.allocateMemory = allocate(fmpy.calloc)
        callbacks.freeMemory = getattr(module, f"{prefix}CallbackFreeMemoryTYPE")(fmpy.free)
        addLoggerProxy(ctypes.byref(callbacks))
        self._callbacks = callbacks  # the binary keeps pointers into it
        key = "functions" if self.major == 1 else "callbacks"
        self.fmu.instantiate(**{key: callbacks, "loggingOn": True})

    def _log(self, *arguments: Any) -> None:
        status, _category, text = arguments[-3:]  # FMI 3 passes no name of the instance before
        self.event_log.log(status, text)

    def initialise(self, inside: Callable[[], None] = lambda: None) -> None:
        """Go through initialization; `inside` is called in initialization mode."""
        start, stop = self.request["start"], self.request["stop"]
        self.t = start
        if self.major == 1:
            if self.continuous:
                self.fmu.setTime(start)
                self.fmu.initialize()
            else:
                self.fmu.initialize(tStart=start, stopTime=stop)
        else:
            if self.major == 2:
                self.fmu.setupExperiment(startTime=start, stopTime=stop)
                self.fmu.enterInitializationMode()
            else:
                self.fmu.enterInitializationMode(startTime=start, stopTime=stop)
            inside()
            self.fmu.exitInitializationMode()
        if self.continuous:
            self._settle()

    def _settle(self) -> None:
        """Handle events until none is left, then enter continuous time."""
        for _ in range(100):
            if self.major == 1:
                self.fmu.eventUpdate()
                return
            name = "newDiscreteStates" if self.major == 2 else "updateDiscreteStates"
            if not getattr(self.fmu, name)()[0]:
                break
        self.fmu.enterContinuousTimeMode()

    def step(self, h: float) -> None:
        """Take one communication step, or one step of Euler's method."""
        if not self.continuous:
            self.fmu.doStep(self.t, h)
            self.t += h
            return
        n = self.request["states"]
        x, dx = (ctypes.c_double * n)(), (ctypes.c_double * n)()
        if n:
            self.fmu.getContinuousStates(x, n)
            name = "getContinuousStateDerivatives" if self.major == 3 else "getDerivatives"
            getattr(self.fmu, name)(dx, n)
        self.t += h
        self.fmu.setTime(self.t)
        if n:
            for i in range(n):
                x[i] += h * dx[i]
            self.fmu.setContinuousStates(x, n)
        ended = self.fmu.completedIntegratorStep()
        if self.major > 1 and ended[0]:
            self.fmu.enterEventMode()
            self._settle()

    def read(self, groups: dict[str, list[list[int]]]) -> list[float]:
        """Return values; `groups` has by type lists of [value reference, number of values]."""
        values: list[float] = []
        for name, entries in groups.items():
            for reference, size in entries:
                get = getattr(self.fmu, f"get{name}")
                found = get([reference], size) if self.major == 3 else get([reference])
                values += [float(value) for value in found]
        return values

    def state_function(self, action: str) -> Any:
        """Return the function that gets, sets, frees, serializes or deserializes a state."""
        if self.major == 3:
            return getattr(self.fmu, f"{action}FMUState")
        return getattr(self.fmu, f"{action.replace('deserialize', 'deSerialize')}FMUstate")


def main(
    end: socket.socket, descriptors: Sequence[int], request: dict[str, Any], folder: str
) -> None:
    """Run the request (see `run.request`) and tell the events."""
    del descriptors
    os.chdir(folder)
    event_log = EventLog(Frames(end, None))
    try:
        _run(request, folder, event_log)
    except fmi1.FMICallException as error:
        event_log.write(refused=str(error), stage=event_log.stage)
    except Exception as error:  # noqa: BLE001 - any kind is a finding
        event_log.write(broken=f"{type(error).__name__}: {error}", stage=event_log.stage)
    event_log.write(end=True)


def _run(request: dict[str, Any], folder: str, event_log: EventLog) -> None:
    event_log.enter("load")
    driver = Driver(request, folder, event_log)
    event_log.enter("instantiate")
    driver.instantiate()
    event_log.enter("initialise")
    driver.initialise(lambda: _compare_starts(driver, request, event_log))
    if request["kind"] != "scheduled execution":
        _step_and_compare(driver, request, event_log)
    event_log.enter("terminate")
    driver.fmu.terminate()
    event_log.enter("free")
    driver.fmu.freeInstance()


def _compare_starts(driver: Driver, request: dict[str, Any], event_log: EventLog) -> None:
    """Compare the parameters, none of them set, with the start values of their description."""
    for name, kind, reference, start in request["starts"]:
        value = driver.read({kind: [[reference, 1]]})[0]
        if not math.isclose(value, start, rel_tol=1e-6, abs_tol=1e-300):
            event_log.write(start=name, described=start, got=repr(value))


def _step_and_compare(driver: Driver, request: dict[str, Any], event_log: EventLog) -> None:
    outputs, h, n = request["outputs"], request["step"], request["steps"]

    def steps(count: int) -> list[float]:
        seen: list[float] = []
        for _ in range(count):
            driver.step(h)
            seen += driver.read(outputs)
        return seen

    def repeated(name: str, begin: Callable[[], None], reference: list[float]) -> None:
        begin()
        if not _same(reference, steps(n)):
            event_log.write(differs=name)

    event_log.enter("first outputs")
    driver.read(outputs)
    event_log.enter("step")
    first = steps(n)
    event_log.write(steps=n, t=driver.t, finite=all(map(math.isfinite, first)))
    if request["state"]:
        event_log.enter("save the state")
        state, t = driver.state_function("get")(), driver.t
        onward = steps(n)

        def back(which: Any) -> None:
            driver.state_function("set")(which)
            driver.t = t
            if driver.continuous:
                driver.fmu.setTime(t)

        event_log.enter("restore the state")
        repeated("state", lambda: back(state), onward)
        if request["serialize"]:
            event_log.enter("serialize the state")
            content = driver.state_function("serialize")(state)
            copy = driver.state_function("deserialize")(content)
            repeated("serialized", lambda: back(copy), onward)
            driver.state_function("free")(copy)
        driver.state_function("free")(state)
    if request["reset"]:
        event_log.enter("reset")
        driver.fmu.reset()
        driver.initialise()
        repeated("reset", lambda: None, first)


def _same(a: list[float], b: list[float]) -> bool:
    """Whether the values are equal, NaN equal to NaN."""
    return len(a) == len(b) and all(
        x == y or (math.isnan(x) and math.isnan(y)) for x, y in zip(a, b, strict=True)
    )
