"""The shared library of an FMU, loaded and called by FMPy's classes for slaves."""

from __future__ import annotations

import os
import re
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import (
    CDLL,
    POINTER,
    addressof,
    byref,
    c_double,
    c_int,
    c_size_t,
    c_uint64,
    c_void_p,
    cast,
    create_string_buffer,
)
from fractions import Fraction
from functools import cache
from inspect import signature
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Any, Final, NamedTuple, Self, get_args

from fmpy import freeLibrary
from fmpy.fmi1 import FMICallException, fmi1String, fmi1True, fmi1ValueReference
from fmpy.fmi2 import FMU2Slave, fmi2String, fmi2ValueReference
from fmpy.fmi3 import (
    FMU3ScheduledExecution,
    FMU3Slave,
    fmi3Binary,
    fmi3String,
    fmi3ValueReference,
)

from cosim.core import ComponentError, note_foreign_code
from cosim.fmu.call_watch import calling
from cosim.fmu.description import FmuDescription
from cosim.fmu.float_mode import call_with_own_float_mode
from cosim.fmu.fmi1_calls import FMU1Calls
from cosim.fmu.inspect.platforms import FMI2, this_machine
from cosim.fmu.messages import fmi1_callbacks, fmi2_callbacks, fmi3_logger
from cosim.fmu.port import FmiVersion
from cosim.fmu.returned import RawInterval, Returned

ACCEPTED_STATUSES: Final = frozenset({0, 1})
"""OK and Warning, with which a call has done its work. Every other status, also one below zero or
one that FMI does not know, is a failure."""
_load_guard: Final = threading.RLock()
"""One library at a time is loaded or unloaded."""
_abandoned: list[Any] = []
"""Slaves that are not freed, after Fatal: their libraries stay, and may call back."""
_CALLBACKS: Final = ("callbacks", "logMessage", "intermediateUpdate", "clockUpdate")
"""Attributes by which FMPy's slaves keep what an FMU may call."""
_callbacks: Final[deque[list[Any]]] = deque(maxlen=1000)
"""Of the last slaves that were freed. A library that stays, as many in C++ do, may call those of an
earlier instance."""


class Loadable(NamedTuple):
    """What it takes to load an FMU.

    Attributes
    ----------
    identifier, token : the model identifier, and the GUID or instantiation token.
    path, folder : the FMU, and where it is unpacked.
    scheduled : it is for scheduled execution (FMI 3).
    """

    version: FmiVersion
    identifier: str
    token: str
    path: Path
    folder: Path
    scheduled: bool = False

    @classmethod
    def of(cls, description: FmuDescription, folder: Path) -> Self:
        """Return what a description says."""
        return cls(
            description.version,
            description.interface.identifier,
            description.token,
            description.path,
            folder,
            description.scheduled,
        )


class SlaveOptions(NamedTuple):
    """What an FMI 3 slave is offered.

    Attributes
    ----------
    event_mode : its events are handled in event mode.
    early_return : it may return from a step before its end.
    intermediate : value references of Float64 outputs that are read within its steps.
    """

    event_mode: bool = False
    early_return: bool = False
    intermediate: tuple[int, ...] = ()


NO_OPTIONS: Final = SlaveOptions()
"""It runs by steps alone."""
IntermediateValues = tuple[float, list[float]]
"""A time [s] and the values of `SlaveOptions.intermediate` there."""
ClockInterval = tuple[RawInterval, int]
"""An interval and its qualifier, as the FMU gives them."""


class CheckedCalls:
    """The calls of FMPy's slave classes, as they are needed here.

    Every FMI call made through a slave passes through `_call`; only the loop, and the exchange of
    values before it (`cosim.master.exchange`), call addresses.

    FMPy 0.3.32 is departed from in these points:

    - FMPy looks up every function of the standard when it loads a library. Here each is looked up
      when it is first used: an FMU may lack what nobody calls.
    - FMPy takes a status below zero for success, and says nothing of rounding modes.
    - FMPy loads a library with its folder as the working directory, which is that of all threads.
      Here it is loaded before (`load_slave`), and the working directory stays as it is.
    - FMPy's FMI 3.0 texts are decoded strictly, and NULL is an exception (`Fmi3Slave`).
    - FMPy believes every size that an FMU returns, and reads or allocates so much.

    Attributes
    ----------
    where : the component, in messages.
    component : address of the instance, None before it is made.
    death, false_text : None: the slave is in this process (`cosim.fmu.isolation`).
    """

    death = false_text = None
    where: str
    component: int | None
    instanceName: str
    dll: Any
    _functions: dict[str, Any]

    def __init__(self, library: CDLL, binary: Loadable, name: str) -> None:
        """Set the attributes that FMPy's methods use; its own `__init__` loads a library."""
        self.dll, self.component, self.callbacks = library, None, None
        self.guid, self.modelIdentifier = binary.token, binary.identifier
        self.unzipDirectory, self.instanceName = str(binary.folder), name
        self.fmiCallLogger, self.requireFunctions, self._functions = None, False, {}

    def function(self, name: str) -> Any:
        """Return a function of the library, with the types that FMPy declares for it.

        Raises
        ------
        ComponentError : the library has no such function.
        """
        found = self._functions.get(name)
        if found is None:
            try:
                found = self.dll[self.symbol(name)]
            except AttributeError as error:
                raise ComponentError(
                    "the FMU lacks a function that the standard asks for",
                    where=self.where,
                    got=str(error),
                ) from error
            found.argtypes, found.restype = _prototype(getattr(type(self), name))
            self._functions[name] = found
        return found

    def symbol(self, name: str) -> str:
        """Return the name that the library has for a function."""
        return name

    def address(self, name: str) -> int:
        """Return the address of a function."""
        return int(c_void_p.from_address(addressof(self.function(name))).value or 0)

    def _call(self, fname: str, *args: Any) -> Any:
        """Call a function of the library: the one place through which every call passes.

        Raises
        ------
        ComponentError : the library has no such function.
        FMICallException : a status that means failure.
        """
        function = self.function(fname)
        with calling(self.instanceName, fname):
            result = call_with_own_float_mode(function, *args)
        if function.restype is c_int and result not in ACCEPTED_STATUSES:
            raise FMICallException(function=fname, status=result)
        return result

    def returned(self, call: str) -> Returned:
        """Return what judges the numbers that a call returned."""
        return Returned(call, self.instanceName, self.where)

    def _serialised(self, state: c_void_p, prefix: str) -> bytes:
        """Return a saved state as bytes; `prefix` : of the functions, such as fmi2FMUstate."""
        version, name, size = prefix[:4], prefix[4:], c_size_t()
        asked = f"{version}Serialized{name}Size"
        self._call(asked, self.component, state, byref(size))
        content = create_string_buffer(self.returned(asked).size_of_state(size.value))
        call = f"{version}Serialize{name}"
        bytes_of = self.function(call).argtypes[2]  # FMPy declares another type in each version
        self._call(call, self.component, state, cast(content, bytes_of), size)
        return content.raw

    def _texts(self, call: str, values: Any) -> list[bytes | None]:
        """Return the texts of an array of pointers that a call has filled."""
        judge, addresses = self.returned(call), cast(values, POINTER(c_void_p))
        return [judge.text(addresses[i]) for i in range(len(values))]

    def abandon(self) -> None:
        """Keep the library, which may call back, and call nothing of it any more."""
        _abandoned.append(self)

    def freeLibrary(self) -> None:
        """Unload the library; nothing of it may be called afterwards."""
        _callbacks.append([getattr(self, name, None) for name in _CALLBACKS])
        with _load_guard, calling(self.instanceName, "unloading the library"):
            call_with_own_float_mode(freeLibrary, self.dll._handle)  # noqa: SLF001 - as FMPy does


class Fmi1Slave(CheckedCalls, FMU1Calls):  # type: ignore[misc]
    """FMPy's slave of FMI 1.0, with checked calls and the life cycle of later versions.

    It is initialised by one call: what sets its inputs in initialization mode comes after that.
    """

    def symbol(self, name: str) -> str:
        """Return the name of a function: FMI 1.0 puts the model identifier before it."""
        return f"{self.modelIdentifier}_{name.replace('fmi1', 'fmi', 1)}"

    def make_instance(
        self, environment: int, *, formats: bool, logging_on: bool, options: SlaveOptions
    ) -> None:
        """Instantiate. A bare Exception is the word for NULL, as it is FMPy's."""
        del environment, formats, options  # messages have the name of the instance alone
        self.instantiate(functions=fmi1_callbacks(), loggingOn=logging_on)
        if not self.component:
            raise Exception("fmiInstantiateSlave returned NULL")  # noqa: TRY002 - as FMPy does

    def enterInitializationMode(
        self, tolerance: float | None = None, startTime: float = 0.0, stopTime: float | None = None
    ) -> None:
        """Initialise (fmiInitializeSlave)."""
        del tolerance
        self.initialize(startTime, stopTime)

    def exitInitializationMode(self) -> None:
        """Do nothing: it is initialised."""

    def setDebugLogging(self, loggingOn: bool, categories: Sequence[str]) -> None:  # noqa: FBT001
        """Let the slave log, or not; it has no categories."""
        del categories
        super().setDebugLogging(loggingOn)

    def doStep(self, time: float, size: float, new_step: bool) -> None:  # noqa: FBT001
        """Step; every step is a new one, since no state is restored."""
        del new_step
        self.fmi1DoStep(self.component, time, size, fmi1True)

    def getRealStatus(self, kind: int) -> float:
        """Return what the slave says of its last step."""
        return float(super().getRealStatus(kind).value)

    def getString(self, vr: list[int]) -> list[bytes | None]:
        """Return texts."""
        references, values = (fmi1ValueReference * len(vr))(*vr), (fmi1String * len(vr))()
        self._call("fmi1GetString", self.component, references, len(vr), values)
        return self._texts("fmi1GetString", values)


class Fmi2Slave(CheckedCalls, FMU2Slave):  # type: ignore[misc]
    """FMPy's slave of FMI 2.0, with checked calls."""

    def make_instance(
        self, environment: int, *, formats: bool, logging_on: bool, options: SlaveOptions
    ) -> None:
        """Instantiate; see `fmi2_callbacks`. A bare Exception is FMPy's word for NULL."""
        del options  # of FMI 3
        callbacks = fmi2_callbacks(environment, formats=formats)
        self.instantiate(callbacks=callbacks, loggingOn=logging_on)

    def getString(self, vr: list[int]) -> list[bytes | None]:
        """Return texts."""
        references, values = (fmi2ValueReference * len(vr))(*vr), (fmi2String * len(vr))()
        self._call("fmi2GetString", self.component, references, len(vr), values)
        return self._texts("fmi2GetString", values)

    def serializeFMUstate(self, state: c_void_p) -> bytes:
        """Return a saved state as bytes."""
        return self._serialised(state, "fmi2FMUstate")


class ClockedCalls(CheckedCalls):
    """Calls of FMI 3.0 that FMPy leaves to its user, with plain results."""

    getIntervalDecimal: Any
    getIntervalFraction: Any
    getShiftDecimal: Any
    getShiftFraction: Any
    setIntervalDecimal: Any
    setIntervalFraction: Any

    def intervals(self, clocks: Sequence[int], fractions: bool) -> list[ClockInterval]:  # noqa: FBT001
        """Return the interval of each Clock, and its qualifier (fmi3GetInterval...)."""
        count, references = len(clocks), (fmi3ValueReference * len(clocks))(*clocks)
        qualifiers = (c_int * count)()
        if fractions:
            counters, resolutions = (c_uint64 * count)(), (c_uint64 * count)()
            self.getIntervalFraction(references, counters, resolutions, qualifiers)
            return list(zip(zip(counters, resolutions, strict=True), qualifiers, strict=True))
        decimals = (c_double * count)()
        self.getIntervalDecimal(references, decimals, qualifiers)
        return list(zip(decimals, qualifiers, strict=True))

    def shifts(self, clocks: Sequence[int], fractions: bool) -> list[RawInterval]:  # noqa: FBT001
        """Return the shift of each Clock (fmi3GetShift...)."""
        count, references = len(clocks), (fmi3ValueReference * len(clocks))(*clocks)
        if fractions:
            counters, resolutions = (c_uint64 * count)(), (c_uint64 * count)()
            self.getShiftFraction(references, counters, resolutions)
            return list(zip(counters, resolutions, strict=True))
        decimals = (c_double * count)()
        self.getShiftDecimal(references, decimals)
        return list(decimals)

    def set_interval(self, clock: int, interval: Fraction, fractions: bool) -> None:  # noqa: FBT001
        """Set the interval of a Clock [s] (fmi3SetInterval...)."""
        references = (fmi3ValueReference * 1)(clock)
        if fractions:
            pair = (c_uint64 * 1)(interval.numerator), (c_uint64 * 1)(interval.denominator)
            self.setIntervalFraction(references, *pair)
        else:
            self.setIntervalDecimal(references, (c_double * 1)(float(interval)))

    def getString(self, vr: list[int], nValues: int) -> list[bytes | None]:
        """Return texts."""
        references = (fmi3ValueReference * len(vr))(*vr)
        values = (fmi3String * nValues)()
        self._call("fmi3GetString", self.component, references, len(vr), values, nValues)
        return self._texts("fmi3GetString", values)

    def getBinary(self, vr: list[int], nValues: int) -> list[bytes]:
        """Return values of type Binary."""
        references = (fmi3ValueReference * len(vr))(*vr)
        sizes, values = (c_size_t * nValues)(), (fmi3Binary * nValues)()
        given = (self.component, references, len(vr), sizes, values, nValues)
        self._call("fmi3GetBinary", *given)
        judge, addresses = self.returned("fmi3GetBinary"), cast(values, POINTER(c_void_p))
        return [judge.content(addresses[i], size) for i, size in enumerate(sizes)]

    def serializeFMUState(self, state: c_void_p) -> bytes:
        """Return a saved state as bytes."""
        return self._serialised(state, "fmi3FMUState")


class Fmi3Slave(ClockedCalls, FMU3Slave):  # type: ignore[misc]
    """FMPy's slave of FMI 3.0, with checked calls."""

    _taken: list[IntermediateValues]
    _intermediate: tuple[int, ...]
    _freed = False
    _raised: BaseException | None = None
    """Raised while values within steps were taken: nothing can be raised through the FMU."""

    def make_instance(
        self, environment: int, *, formats: bool, logging_on: bool, options: SlaveOptions
    ) -> None:
        """Instantiate. A bare Exception is FMPy's word for NULL."""
        del formats  # messages of FMI 3 are texts
        self._taken, self._intermediate = [], options.intermediate
        self.instantiate(
            loggingOn=logging_on,
            eventModeUsed=options.event_mode,
            earlyReturnAllowed=options.early_return,
            logMessage=fmi3_logger(environment),
            intermediateUpdate=self._update if options.intermediate else None,
            requiredIntermediateVariables=list(options.intermediate) or None,
        )

    def _update(
        self,
        _environment: int | None,
        time: float,
        _set_requested: bool,  # noqa: FBT001
        get_allowed: bool,  # noqa: FBT001
        finished: bool,  # noqa: FBT001
        _can_return_early: bool,  # noqa: FBT001
        early_return_requested: Any,
        _early_return_time: Any,
    ) -> None:
        """Take the values within a step that belong to a finished step of the FMU's solver."""
        early_return_requested[0] = False
        if get_allowed and finished and self._raised is None and not self._freed:
            references = list(self._intermediate)
            try:
                self._taken.append((time, self.getFloat64(references, len(references))))
            except BaseException as error:  # noqa: BLE001 - raised when they are asked for
                self._raised = error

    def taken(self) -> list[IntermediateValues]:
        """Return the values within steps since the last call, with their times [s]."""
        found, self._taken = self._taken, []
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised
        return found

    def freeInstance(self) -> None:
        """Free the instance and unload the library, which may call back as long as it is there."""
        self._freed = True
        super().freeInstance()


class Fmi3Scheduled(ClockedCalls, FMU3ScheduledExecution):  # type: ignore[misc]
    """FMPy's FMU for scheduled execution, as a slave whose Clocks activate its model partitions.

    It has no modes and no steps: time is what the master says. The partitions of Clocks that tick
    are activated when the super-dense instant ends: its inputs are set by then.
    """

    _now = 0.0
    _ticking: list[int]

    def make_instance(
        self, environment: int, *, formats: bool, logging_on: bool, options: SlaveOptions
    ) -> None:
        """Instantiate. A bare Exception is FMPy's word for NULL."""
        del formats, options
        self._ticking = []
        self.instantiate(loggingOn=logging_on, logMessage=fmi3_logger(environment))

    def enterInitializationMode(
        self, tolerance: float | None = None, startTime: float = 0.0, stopTime: float | None = None
    ) -> None:
        """Enter initialization mode, at the time from which Clocks tick."""
        self._now = startTime
        super().enterInitializationMode(tolerance, startTime, stopTime)

    def enterEventMode(self) -> None:
        """Do nothing: model partitions are activated at any time."""

    def enterStepMode(self) -> None:
        """Do nothing."""

    def updateDiscreteStates(self) -> tuple[bool, bool, bool, bool, bool, float]:
        """Activate the model partitions of the Clocks that tick, in this order."""
        clocks, self._ticking = self._ticking, []
        for clock in clocks:
            self.activateModelPartition(clock, self._now)
        # one more instant, for the output Clocks that tick with them
        return bool(clocks), False, False, False, False, 0.0

    def advance(self, time: float) -> None:
        """Let time go on to `time` [s]."""
        self._now = time

    def setClock(self, vr: Sequence[int], values: Sequence[bool]) -> None:
        """Let Clocks tick."""
        self._ticking += [clock for clock, ticks in zip(vr, values, strict=True) if ticks]


_CLASSES: Final[Mapping[FmiVersion, type[Any]]] = MappingProxyType(
    {"1.0": Fmi1Slave, "2.0": Fmi2Slave, "3.0": Fmi3Slave}
)


@cache
def _prototype(method: Any) -> tuple[list[Any], Any]:
    """Return the types of arguments and result that FMPy notes at its method for a function."""
    noted = signature(method)
    arguments = [p.annotation for p in list(noted.parameters.values())[1:]]
    types = [get_args(one)[0] if isinstance(one, UnionType) else one for one in arguments]
    result = noted.return_annotation
    return types, c_int if result is int else result


@contextmanager
def _cannot_be_loaded(binary: Loadable, where: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        here = this_machine()
        sources = (binary.folder / "sources").is_dir()
        raise ComponentError(
            "the FMU cannot be loaded",
            where=where,
            expected=f"a library for {here.architecture} {here.system} that loads",
            got=str(error),
            hint="it brings its C sources: fmpy compile" if sources else None,
        ) from error


def require_library(binary: Loadable, component: str) -> None:
    """Check that there is a library for this machine; nothing is loaded.

    Raises
    ------
    ComponentError : as `load_slave`.
    """
    with _cannot_be_loaded(binary, _place(binary, component)):
        _library_of(binary)


def _place(binary: Loadable, component: str) -> str:
    return f"component {component!r} ({binary.path})"


def load_slave(binary: Loadable, component: str, where: str) -> Any:
    """Return FMPy's slave of an FMU; it is not instantiated yet.

    Raises
    ------
    ComponentError : no library for this machine, one of another name, or it does not load.
    """
    note_foreign_code(component)
    with _cannot_be_loaded(binary, _place(binary, component)):
        path = _library_of(binary).absolute()
        with _load_guard, calling(component, "loading the library"):
            library = call_with_own_float_mode(_loaded_library, path)
    slave_class = Fmi3Scheduled if binary.scheduled else _CLASSES[binary.version]
    slave = slave_class(library, binary, component)
    slave.where = where
    return slave


_MISSING: Final = re.compile(r"([^/:]+): cannot open shared object file")


def _loaded_library(path: Path, tried: frozenset[Path] = frozenset()) -> CDLL:
    """Load a library, and what it needs of the libraries beside it, wherever this process is.

    One that would look for them in the working directory finds them loaded; `tried` did not help.

    Raises
    ------
    OSError : it does not load.
    """
    with _searched(path.parent):
        try:
            return CDLL(str(path))
        except OSError as error:
            found = _MISSING.match(str(error))
            beside = path.with_name(found[1]) if found else path
            if beside in {path, *tried} or not beside.is_file():
                raise
        needed = _loaded_library(beside, tried | {path})
        try:
            return _loaded_library(path, tried | {beside})
        finally:
            freeLibrary(needed._handle)  # noqa: SLF001 - the other library keeps it


@contextmanager
def _searched(folder: Path) -> Iterator[None]:
    """Let Windows look for needed libraries in a folder."""
    if sys.platform != "win32":
        yield
        return
    with os.add_dll_directory(str(folder)):
        yield


def _library_of(binary: Loadable) -> Path:
    """Return the library for this machine, or raise an `OSError` that lists what there is."""
    identifier, here = binary.identifier, this_machine()
    tuple_name = f"{here.architecture}-{here.system}"
    short = [name for name, platform in FMI2.items() if platform == here]
    folders = [tuple_name] if binary.version == "3.0" else [*short, tuple_name]
    binaries = binary.folder / "binaries"
    for name in folders:
        library = binaries / name / f"{identifier}{here.suffix}"
        if library.is_file():
            return library
        others = sorted(p.name for p in library.parent.glob(f"*{here.suffix}"))
        if others:
            raise OSError(
                f"binaries/{name} holds {', '.join(others)}, but the model identifier is "
                f"{identifier}"
            )
    platforms = sorted(p.name for p in binaries.glob("*") if p.is_dir())
    raise OSError(
        f"it has no binary for {folders[0]}, only for {', '.join(platforms)}"
        if platforms
        else f"it has no binary for {folders[0]}, nor for any other platform"
    )
