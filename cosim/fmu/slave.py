"""One running FMU 2.0 slave, loaded by fmpy.

Life cycle, each method once and in this order:

    FmuSlave(...)  ->  initialise(parameters, start, stop)  ->  write / step / read ...
                   ->  close()

After an error only `close` is allowed. `close` may be called at any time and any number of
times; it terminates the slave, frees it and removes its files.
"""

from __future__ import annotations

import ctypes
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Literal, Self

import fmpy
import numpy as np
from fmpy import fmi2
from numpy.typing import NDArray

from cosim.errors import ComponentError, InputError
from cosim.fmu.description import FmuDescription, Port

LogSink = Callable[[str, str], None]
"""Takes (level, message): level is debug, info, warning, error or fatal."""

_LEVELS = {0: "info", 1: "warning", 2: "warning", 3: "error", 4: "fatal"}
_STATUS = {2: "fmi2Discard", 3: "fmi2Error", 4: "fmi2Fatal", 5: "fmi2Pending"}
_CALLS: dict[str, tuple[str, str, Any]] = {
    "float": ("fmi2GetReal", "fmi2SetReal", ctypes.c_double),
    "int": ("fmi2GetInteger", "fmi2SetInteger", ctypes.c_int),
    "bool": ("fmi2GetBoolean", "fmi2SetBoolean", ctypes.c_int),
}


class Bundle:
    """Several variables of one slave, read or written as one row of doubles.

    Integers and Booleans are carried as doubles, which hold them exactly. The C arrays are
    made once: a call costs one crossing per type, not one per variable.
    """

    def __init__(self, slave: FmuSlave, ports: Sequence[Port]) -> None:
        self.ports = tuple(ports)
        self._groups = []
        for kind, (getter, setter, c_type) in _CALLS.items():
            places = [i for i, port in enumerate(ports) if port.kind == kind]
            if not places:
                continue
            n = len(places)
            references = (ctypes.c_uint * n)(*(ports[i].reference for i in places))
            buffer: Any = (c_type * n)()
            view = np.ctypeslib.as_array(buffer)
            self._groups.append(
                (
                    getattr(slave.fmu, getter),
                    getattr(slave.fmu, setter),
                    np.array(places),
                    references,
                    n,
                    buffer,
                    view,
                )
            )
        self._slave = slave

    def read(self, row: NDArray[np.float64]) -> None:
        """Fill `row` (one entry per port)."""
        for getter, _, places, references, n, buffer, view in self._groups:
            self._slave.call("get", getter, references, n, buffer)
            row[places] = view

    def write(self, row: NDArray[np.float64]) -> None:
        """Set every port from `row`."""
        for _, setter, places, references, n, buffer, view in self._groups:
            view[:] = row[places]
            self._slave.call("set", setter, references, n, buffer)


class FmuSlave:
    """A slave between instantiation and the end; see the module for its life cycle."""

    def __init__(self, description: FmuDescription, name: str, log: LogSink) -> None:
        self.name = name
        self.description = description
        self.last_error: str | None = None
        self._log = log
        self._open = True
        self._stepping = False
        self._fatal = False
        self._folder = tempfile.mkdtemp(prefix="cosim-")
        self.fmu: Any = None
        try:
            fmpy.extract(str(description.path), unzipdir=self._folder)
            self.fmu = fmi2.FMU2Slave(
                guid=description.model.guid,
                unzipDirectory=self._folder,
                modelIdentifier=description.model.coSimulation.modelIdentifier,
                instanceName=name,
            )
            self._callbacks = self._make_callbacks()
            self.fmu.instantiate(callbacks=self._callbacks, loggingOn=True)
        except Exception as error:
            reason = self.last_error or str(error)
            self._remove()
            raise ComponentError(
                "the FMU cannot be loaded",
                where=f"component {name!r} ({description.path})",
                expected=f"a binary for {fmpy.platform} that loads",
                got=reason,
            ) from error

    def _make_callbacks(self) -> Any:
        def logger(_env: int, _who: bytes, status: int, _category: bytes, text: bytes) -> None:
            message = text.decode("utf-8", "replace") if text else ""
            if status >= 2:
                self.last_error = message
            self._log(_LEVELS.get(status, "error"), message)

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(logger)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        return callbacks

    def initialise(self, parameters: Mapping[str, float], start: float, stop: float) -> None:
        """Set parameters and start values, and pass through initialization mode."""
        self.set_start(parameters)
        self.enter_initialisation(start, stop)
        self.exit_initialisation()

    def set_start(self, parameters: Mapping[str, float]) -> None:
        """Set parameters and start values, before initialization mode.

        Raises
        ------
        InputError : an unknown parameter, or one that cannot be set.
        ComponentError : the slave refuses.
        """
        settable = []
        for name in parameters:
            where = f"component {self.name!r}"
            port = self.description.port(name, where=where)
            if port.kind is None:
                raise InputError(
                    f"{name} is of a type that cannot be set here",
                    where=where,
                    expected="Real, Integer, Enumeration or Boolean",
                )
            if port.causality not in ("parameter", "structuralParameter", "input"):
                raise InputError(
                    f"{name} cannot be set",
                    where=where,
                    expected="a parameter or an input",
                    got=f"causality {port.causality}",
                )
            _check_range(port, parameters[name], where)
            settable.append(port)
        if settable:
            row = np.array([parameters[port.name] for port in settable], dtype=np.float64)
            Bundle(self, settable).write(row)

    def enter_initialisation(self, start: float, stop: float) -> None:
        """Set up the experiment from `start` to `stop` [s], and enter initialization mode."""
        fmu = self.fmu
        self.call("setupExperiment", fmu.fmi2SetupExperiment, 0, 0.0, start, 1, stop)
        self.call("enterInitializationMode", fmu.fmi2EnterInitializationMode)

    def exit_initialisation(self) -> None:
        """Leave initialization mode; from here on the slave takes steps."""
        self.call("exitInitializationMode", self.fmu.fmi2ExitInitializationMode)
        if self.last_error is not None:
            raise self._failed("initialisation")
        self._stepping = True

    def step(self, time: float, size: float) -> None:
        """Advance from `time` by `size` [s].

        Raises
        ------
        ComponentError : the slave cannot compute the step.
        """
        self.call(f"step from t = {time:g} s", self.fmu.fmi2DoStep, time, size, 1)

    @property
    def component(self) -> int:
        """Address of the instance."""
        return int(self.fmu.component)

    def address(self, way: Literal["get", "set", "step"], getter_type: str = "Real") -> int:
        """Address of fmi2Get..., fmi2Set... (for variables of a type) or fmi2DoStep."""
        name = "fmi2DoStep" if way == "step" else f"fmi2{way.title()}{getter_type}"
        found = ctypes.cast(self.fmu.dll[name], ctypes.c_void_p).value
        return int(found or 0)

    def refused(self, what: str, status: int) -> ComponentError:
        """The error that a status beyond Warning stands for; the slave takes no more steps."""
        self._stepping = False
        return ComponentError(
            f"{what} returned {_STATUS.get(status, f'status {status}')}",
            where=f"component {self.name!r} ({self.description.path.name})",
            got=self.last_error,
        )

    def abandon(self) -> None:
        """Call nothing of this slave any more: one of its FMU has reported fmi2Fatal."""
        self._fatal = True

    def call(self, what: str, function: Any, *arguments: Any) -> None:
        """Call an FMI function on this instance; any status beyond Warning is an error."""
        try:
            function(self.fmu.component, *arguments)
        except Exception as error:
            self._stepping = False
            raise self._failed(what, str(error)) from error

    def _failed(self, what: str, fallback: str = "") -> ComponentError:
        return ComponentError(
            f"{what} failed",
            where=f"component {self.name!r} ({self.description.path.name})",
            got=self.last_error or fallback,
        )

    def close(self) -> None:
        """Terminate, free, remove the unpacked files."""
        if not self._open:
            return
        self._open = False
        try:
            if self._stepping and not self._fatal:
                self.fmu.terminate()
            if not self._fatal:
                self.fmu.freeInstance()
        except Exception as error:  # noqa: BLE001 - the run is over; what is left is to say so
            self._log("warning", f"freeing the slave: {error}")
        finally:
            self._remove()

    def _remove(self) -> None:
        self._open = False
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _check_range(port: Port, value: float, where: str) -> None:
    """Refuse what the model description rules out, before the slave has to."""
    low, high = port.minimum, port.maximum
    if (low is not None and value < low) or (high is not None and value > high):
        bounds = [f">= {low:g}"] if low is not None else []
        bounds += [f"<= {high:g}"] if high is not None else []
        raise InputError(
            f"{port.name} is out of range",
            where=where,
            expected=" and ".join(bounds),
            got=f"{value:g}",
        )
