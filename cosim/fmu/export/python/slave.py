"""The pythonfmu slave around a behaviour: life cycle, variables, refusals, state.

pythonfmu turns an exception of the slave into fmi2Fatal and frees the instance; the next call
of a host that goes on then crashes. So nothing is raised here: a refused call is logged as an
error, changes no value, and makes the next step fail. Standard library and pythonfmu only.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import json
import math
import os
import sys
from pathlib import Path
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status


def _part_from_binary(resources: str, name: str) -> None:
    """Release Python's state in PythonFMU's binary before the process ends.

    A GNU C++ library with unique symbols is not unloaded before the process ends. Then PythonFMU's
    shared pointer is destroyed first and afterwards set to null by the library's own destructor,
    on freed memory, so that the host sometimes aborts after its work. Setting it to null here, at
    the end of Python, prevents that.
    """
    binary = Path(resources).parent / "binaries" / "linux64" / f"{name}.so"
    with contextlib.suppress(OSError, AttributeError):  # unloaded already
        ctypes.CDLL(str(binary), mode=os.RTLD_NOLOAD | os.RTLD_NOW).finalizePythonInterpreter()


def _beyond(name: str, value: Any, low: Any, high: Any) -> str | None:
    """Say which bound a value is beyond; None if it is beyond none."""
    if low is not None and value < low:
        return f"{name} must be at least {low}, got {value!r}"
    if high is not None and value > high:
        return f"{name} must be at most {high}, got {value!r}"
    return None


class BehaviourSlave(Fmi2Slave):  # type: ignore[misc]  # pythonfmu has no types
    """A slave with the variables of `TABLE`, computed by a `BEHAVIOUR`.

    The generated module of each FMU derives from it and sets the three class attributes. Nothing is
    registered with PythonFMU, which would count value references from 0: `TABLE` says all.
    """

    TABLE: tuple[dict[str, Any], ...] = ()
    BEHAVIOUR: Any = None
    CONSTANTS: dict[str, Any] = {}  # noqa: RUF012 - replaced as a whole by each FMU
    PARTED: set[str] = set()  # noqa: RUF012 - one for all instances

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        # in a host without Python the binary ends Python itself while it holds the loader's lock:
        # the function below would wait for that lock for ever
        resources = str(self.resources)
        if sys.platform == "linux" and sys.orig_argv and resources not in self.PARTED:
            self.PARTED.add(resources)  # once per binary, not per instance
            atexit.register(_part_from_binary, resources, type(self).__name__)
        self._names = [entry["name"] for entry in self.TABLE]
        self._values: dict[str, Any] = {entry["name"]: entry["start"] for entry in self.TABLE}
        self._behaviour = self.BEHAVIOUR(self.CONSTANTS)
        self._phase = "instantiated"  # -> initializing -> running -> terminated
        self._time, self._stop = 0.0, math.inf
        self._stale = False  # parameters or inputs changed since the outputs were computed
        self._refused: str | None = None

    # ---- life cycle

    def setup_experiment(
        self, start_time: float, stop_time: float | None, tolerance: float | None
    ) -> None:
        """Take start and stop time; these components ignore the tolerance.

        PythonFMU drops what this returns: a stop time that is refused fails the next step.
        """
        del tolerance
        stop = math.inf if stop_time is None else stop_time
        if not (math.isfinite(start_time) and stop >= start_time):
            self._refuse(
                f"the stop time, {stop!r} s, must not be before the start time, {start_time!r} s"
            )
            return
        self._time, self._stop = start_time, stop

    def enter_initialization_mode(self) -> None:
        """Enter initialization mode, in which the outputs follow the parameters."""
        if self._phase != "instantiated":
            self._refuse(f"enterInitializationMode is not allowed while {self._phase}")
            return
        self._phase = "initializing"
        self._initialise()

    def exit_initialization_mode(self) -> None:
        """Fix the parameters; the outputs are those of the initial state."""
        if self._phase != "initializing":
            self._refuse(f"exitInitializationMode is not allowed while {self._phase}")
            return
        self._initialise()
        self._phase = "running"

    def terminate(self) -> None:
        """End the run; values stay readable."""
        self._phase = "terminated"

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance; return False, with a logged reason, if the step cannot be computed."""
        try:
            return self._do_step(current_time, step_size)
        except Exception as error:  # noqa: BLE001 - see the module: nothing is raised
            return self._refuse(f"doStep at t = {current_time!r} s: {error}")

    def _do_step(self, current_time: float, step_size: float) -> bool:
        if self._refused is not None:
            return self._refuse(self._refused)
        if self._phase != "running":
            return self._refuse(f"doStep is not allowed while {self._phase}")
        end = current_time + step_size
        why = self._objection_to_step(current_time, step_size, end)
        if why is not None:
            return self._refuse(why)
        if end > self._time:
            self._behaviour.advance(self._values, end)
            self._time = end
        self._stale = False
        return True

    def _objection_to_step(self, start: float, size: float, end: float) -> str | None:
        if not (math.isfinite(size) and size >= 0.0):
            return f"the step must be finite and not negative, got {size!r} s"
        if not math.isfinite(start):
            return f"the step must start at a finite time, got {start!r} s"
        # a master that adds up its steps drifts by rounding; anything more is an error
        if abs(start - self._time) > 1e-9 * max(1.0, abs(self._time)):
            return (
                f"the step starts at t = {start!r} s, but the instance is at {self._time!r} s; set "
                "a saved state to go back"
            )
        if end - self._stop > 1e-9 * max(1.0, abs(self._stop)):
            return f"the step ends at t = {end!r} s, after the stop time of {self._stop!r} s"
        return None

    def _initialise(self) -> None:
        try:
            self._behaviour.initialise(self._values, self._time)
            self._stale = False
        except Exception as error:  # noqa: BLE001 - see the module: nothing is raised
            self._refuse(f"initialisation: {error}")

    def _refuse(self, why: str) -> bool:
        self._refused = why
        self.log(why, Fmi2Status.error, "logStatusError")
        return False

    # ---- variables

    def get_real(self, vrs: list[int]) -> list[float]:
        """Return Real variables; an unknown reference is logged and reads as 0."""
        return [float(value) for value in self._get(vrs, "Real")]

    def get_integer(self, vrs: list[int]) -> list[int]:
        """Return Integer variables; an unknown reference is logged and reads as 0."""
        return [int(value) for value in self._get(vrs, "Integer")]

    # No component has Boolean or String variables. PythonFMU's own methods would raise, and the
    # host would crash a few calls later.

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """Log the type that the variables have; return False for each."""
        return [bool(value) for value in self._get(vrs, "Boolean")]

    def get_string(self, vrs: list[int]) -> list[str]:
        """Log the type that the variables have; return an empty text for each."""
        return [str(value or "") for value in self._get(vrs, "String")]

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """Log the type that the variables have."""
        self._set(vrs, values, "Boolean")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        """Log the type that the variables have."""
        self._set(vrs, values, "String")

    def _get(self, vrs: list[int], kind: str) -> list[Any]:
        if self._stale:
            self._refresh()
        try:
            return [self._values[self._names[self._known(vr, kind)]] for vr in vrs]
        except LookupError as error:
            self._refuse(str(error.args[0]))
            return [0] * len(vrs)

    def _refresh(self) -> None:
        if self._phase == "initializing":
            self._initialise()
        elif self._phase == "running":
            try:
                self._behaviour.refresh(self._values)
            except Exception as error:  # noqa: BLE001 - see the module: nothing is raised
                self._refuse(f"outputs: {error}")
            self._stale = False

    def _known(self, vr: int, kind: str) -> int:
        """Return the place of a variable; value references count places from 1."""
        if not 1 <= vr <= len(self.TABLE):
            raise LookupError(f"value reference {vr} is unknown; 1 to {len(self.TABLE)} exist")
        entry = self.TABLE[vr - 1]
        if entry["kind"] != kind:
            name, found = entry["name"], entry["kind"]
            raise LookupError(f"value reference {vr} ({name}) is of type {found}, not {kind}")
        return vr - 1

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Write Real variables, all or, with a logged refusal, none."""
        self._set(vrs, values, "Real")

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        """Write Integer variables, all or, with a logged refusal, none."""
        self._set(vrs, values, "Integer")

    def _set(self, vrs: list[int], values: list[Any], kind: str) -> None:
        for vr, value in zip(vrs, values, strict=True):
            why = self._objection(vr, value, kind)
            if why is not None:
                self._refuse(why)
                return
        for vr, value in zip(vrs, values, strict=True):
            self._values[self._names[vr - 1]] = value
        self._stale = True

    def _objection(self, vr: int, value: Any, kind: str) -> str | None:
        try:
            entry = self.TABLE[self._known(vr, kind)]
        except LookupError as error:
            return str(error.args[0])
        name, causality = entry["name"], entry["causality"]
        if not math.isfinite(value):
            return f"{name} must be finite, got {value!r}"
        if causality == "output" and self._phase != "instantiated":
            return f"{name} is an output and cannot be written"
        if causality == "parameter" and self._phase not in ("instantiated", "initializing"):
            return f"{name} is a fixed parameter and cannot be written after initialisation"
        return _beyond(name, value, entry["minimum"], entry["maximum"])

    # ---- the whole state

    def _get_fmu_state(self) -> dict[str, Any]:
        state = {
            "values": dict(self._values),
            "phase": self._phase,
            "time": self._time,
            "stop": None if math.isinf(self._stop) else self._stop,  # JSON has no infinity
            "stale": self._stale,
            "refused": self._refused,
            "behaviour": None,
        }
        if self._phase != "instantiated":
            state["behaviour"] = self._behaviour.snapshot()
        # a deep copy, which the instance does not change later
        copy: dict[str, Any] = json.loads(json.dumps(state))
        return copy

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> dict[str, Any]:
        # an unreadable state is refused when it is restored: see `_set_fmu_state`
        try:
            found = json.loads(state.decode("utf-8"))
        except ValueError as error:
            return {"unreadable": str(error)}
        return found if isinstance(found, dict) else {"unreadable": "no saved state"}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        if "unreadable" in state:
            self._refuse(f"the saved state cannot be read: {state['unreadable']}")
            return
        values = state.get("values")
        if not isinstance(values, dict) or values.keys() != self._values.keys():
            self._refuse("the saved state is not one of this component: its variables differ")
            return
        try:
            self._values.update(state["values"])
            self._time = state["time"]
            self._stop = math.inf if state["stop"] is None else state["stop"]
            if state["behaviour"] is not None:
                self._behaviour.initialise(self._values, self._time)
                self._behaviour.restore(state["behaviour"])
                self._values.update(state["values"])
            self._phase, self._stale = state["phase"], state["stale"]
            self._refused = state["refused"]
        except Exception as error:  # noqa: BLE001 - see the module: nothing is raised
            self._refuse(f"the saved state does not fit this component: {error}")
