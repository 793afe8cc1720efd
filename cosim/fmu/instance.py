"""One instance of an FMU: load it, call its functions, take its messages, free it.

FMPy's slave classes load the library and own the instance (`cosim.fmu.binary`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal
from weakref import WeakSet

from fmpy.fmi1 import FMICallException

from cosim.core import ComponentError, InputError
from cosim.fmu.binary import (
    ACCEPTED_STATUSES,
    NO_OPTIONS,
    Loadable,
    SlaveOptions,
    load_slave,
    require_library,
)
from cosim.fmu.description import FmuDescription
from cosim.fmu.messages import (
    LEVELS,
    LogSink,
    register_sink,
    unregister_sink,
    with_names,
)
from cosim.fmu.port import FmiVersion, Phase
from cosim.fmu.returned import Returned
from cosim.fmu.unpacking import unpack_fmu

if TYPE_CHECKING:
    from cosim.fmu.isolation import SlaveProcess

WARNING, DISCARD, ERROR, FATAL = 1, 2, 3, 4
"""fmiStatus, fmi2Status and fmi3Status; 0 is OK."""
PREFIX: Final[Mapping[FmiVersion, str]] = MappingProxyType(
    {"1.0": "fmi1", "2.0": "fmi2", "3.0": "fmi3"}
)
_STATUS: Final = MappingProxyType(
    {
        "1.0": {2: "Discard", 3: "Error", 4: "Fatal", 5: "Pending"},
        "2.0": {2: "Discard", 3: "Error", 4: "Fatal", 5: "Pending"},
        "3.0": {2: "Discard", 3: "Error", 4: "Fatal"},
    }
)
_CLAIM: Final = "logStatus"
"""Prefix of the standard's log categories for the status of a call. Some exporters, PythonFMU among
them, log an error there and return OK: the message counts. Errors in other categories do not, since
some tools log their progress as errors."""
_PYTHONFMU: Final = "slavemodule.txt"
"""A file that PythonFMU puts into the resources. PythonFMU passes messages as formats without
arguments: formatting a per cent sign would read memory at random, or crash. And it reports every
failed step as a slave that asks for the end."""
_open_instances: WeakSet[Instance] = WeakSet()
_open_guard: Final = threading.RLock()


def require_loadable(description: FmuDescription, component: str) -> None:
    """Ask what `FmuSlave` asks of an FMU before any of its code runs.

    Raises
    ------
    InputError : it cannot be unpacked.
    ComponentError : it has no library for this machine.
    """
    require_library(Loadable.of(description, unpack_fmu(description)), component)


class Instance:
    """An instance between instantiation and the end.

    Attributes
    ----------
    name : of the component.
    description : of the FMU; array shapes follow the structural parameters once they are set.
    version : of FMI.
    phase : of its life cycle.
    options : what it is offered beside steps, in FMI 3.
    last_error : the last message with a status beyond Warning since the last call from here.
    end_failure : what ended the process of an isolated slave while it was terminated or freed.
    _logged_error : the last message that counts as an error of the present call.
    """

    def __init__(
        self,
        description: FmuDescription,
        name: str,
        log: LogSink,
        *,
        categories: Sequence[str] | None = None,
        process: SlaveProcess | None = None,
        options: SlaveOptions = NO_OPTIONS,
    ) -> None:
        self.name = name
        self.description = description
        self.version = description.version
        self.phase: Phase = "instantiated"
        self.last_error: str | None = None
        self._logged_error: str | None = None
        self._log = log
        self._categories = categories
        self.options = options
        self._fatal = False
        self._where = f"component {name!r} ({description.path.name})"
        self._check_categories()
        self._process = process
        self.end_failure: ComponentError | None = None
        self._fmu: Any = None
        self._environment = 0
        with _open_guard:  # of two threads that begin at the same time one is refused
            self._check_alone()
            _open_instances.add(self)
        try:
            folder = unpack_fmu(description)
            self._of_pythonfmu = (folder / "resources" / _PYTHONFMU).is_file()
            self._fmu = self._loaded(Loadable.of(description, folder))
            self._environment = register_sink(name, self._on_message)
            self._instantiate()
        except BaseException:
            self.end(terminate=False)
            raise
        if description.departures:
            self._log("warning", f"breaks the standard: {'; '.join(description.departures)}", "")
        for variable in description.model.variables:
            why = description.unusable.get(variable.name)
            if why is not None and variable.causality in ("input", "output"):
                self._log("warning", f"{variable.name} is left out: {why}", "")

    def _loaded(self, binary: Loadable) -> Any:
        if self._process is None:
            return load_slave(binary, self.name, self._where)
        from cosim.fmu.isolation.proxy import IsolatedSlave  # noqa: PLC0415 - few are isolated

        return IsolatedSlave(self._process, binary, self.name, self._where)

    def _check_categories(self) -> None:
        known = self.description.model.named["log category"]
        for category in self._categories or ():
            if category not in known:
                raise InputError.unknown("log category", category, known, where=self._where)

    def _check_alone(self) -> None:
        if not self.description.can_be_instantiated_only_once:
            return
        for other in self._of_this_fmu_here():
            if other.phase != "closed":
                raise InputError(
                    "this FMU can be instantiated only once in a process",
                    where=self._where,
                    got=f"component {other.name!r} is an instance of it",
                    hint="isolate = true for all of its components but one, or for all",
                )

    def _of_this_fmu_here(self) -> list[Instance]:
        """Return all open instances of its FMU in the same process."""
        if self._process is not None:  # isolated: it is there alone
            return []
        digest = self.description.sha256
        with _open_guard:
            return [
                other
                for other in _open_instances
                if other._process is None and other.description.sha256 == digest  # noqa: SLF001
            ]

    def _instantiate(self) -> None:
        try:
            self._fmu.make_instance(
                self._environment,
                formats=not self._of_pythonfmu,
                logging_on=self._categories is None or bool(self._categories),
                options=self.options,
            )
        except Exception as error:
            if type(error) is not Exception:  # a bare one is FMPy's word for NULL
                raise
            description = self.description
            raise ComponentError(
                "the FMU refuses to be instantiated",
                where=self._where,
                got=self.last_error or "no message",
                hint=f"it needs a program to run in, made by: {description.tool or 'not said'}"
                if description.needs_execution_tool
                else None,
            ) from error
        self.last_error = self._logged_error = None
        if self._categories is not None:
            chosen = list(self._categories)
            self._do("choosing log categories", "setDebugLogging", bool(chosen), chosen)

    @property
    def component(self) -> int:
        """Address of the instance."""
        return int(self._fmu.component or 0)

    def _on_message(self, status: int, category: str, message: str) -> None:
        if self.version != "3.0" and "#" in message:
            message = with_names(message, self._name_of)
        if status >= DISCARD:
            self.last_error = message
        if status >= ERROR and category.startswith(_CLAIM):
            self._logged_error = message
        wanted = self._categories is None or category in self._categories
        if wanted or status > WARNING:
            self._log(LEVELS.get(status, "error"), message, category)

    def _name_of(self, getter_type: str, reference: int) -> str | None:
        for port in self.description.ports.values():
            if (port.getter_type, port.reference) == (getter_type, reference):
                return port.name
        return None

    def address(self, way: Literal["get", "set", "step"], getter_type: str = "") -> int:
        """Return the address of fmiNGet... or fmiNSet... for a type, or of fmiNDoStep.

        Raises
        ------
        ComponentError : the FMU has no such function.
        """
        return int(self._fmu.address(self._function(way, getter_type)))

    def returned(self, way: Literal["get", "set", "step"], getter_type: str = "") -> Returned:
        """Return what judges the numbers that such a function returned."""
        return self._returned(self._function(way, getter_type))

    def _function(self, way: Literal["get", "set", "step"], getter_type: str) -> str:
        name = {"get": f"Get{getter_type}", "set": f"Set{getter_type}", "step": "DoStep"}[way]
        return PREFIX[self.version] + name

    def _do(self, what: str, method: str, *arguments: Any) -> Any:
        """Call a method of FMPy's slave and return its result.

        Raises
        ------
        ComponentError : a status that means failure, a missing function, or a call after the end.
        """
        try:
            return self._attempt(method, *arguments)
        except FMICallException as error:
            raise self.refused(what, error.status, call=error.function) from error

    def _returned(self, call: str) -> Returned:
        """Return what judges the numbers that a call returned."""
        return Returned(call, self.name, self._where)

    def _attempt(self, method: str, *arguments: Any) -> Any:
        """Call a method of FMPy's slave; a status that means failure is an FMICallException."""
        if self._fatal or self.phase in ("failed", "closed"):
            raise ComponentError(
                f"{PREFIX[self.version]}{method[0].upper()}{method[1:]} is called after the end",
                where=self._where,
                expected="nothing but close",
                got=self.last_error,
            )
        self.last_error = None
        try:
            return getattr(self._fmu, method)(*arguments)
        except ComponentError as error:
            if error.kind is not None:
                self.phase = "failed"
            raise

    def refused(
        self, what: str, status: int, detail: str = "", *, call: str | None = None
    ) -> ComponentError:
        """Return the error of a refused call; only `close` is allowed after it.

        After Fatal no instance of the FMU may be called. A call with an accepted status is refused
        for an error that it has logged. `detail` is added to the sentence; `call` : the function.
        """
        self.phase = "failed"
        if self._fmu.death is not None:
            death: ComponentError = self._fmu.death.error(what)
            return death
        if self._fmu.false_text is not None:
            judged: ComponentError = self._fmu.false_text
            judged.what = f"{what}: {judged.what}"
            return judged
        self._abandon_all(status)
        word = _STATUS[self.version].get(status)
        returned = f"returned status {status}, which FMI does not know"
        if status in ACCEPTED_STATUSES:
            returned = "logged an error"
        elif word:
            returned = f"returned {PREFIX[self.version]}{word}"
        return ComponentError(
            f"{what} {returned}{detail}",
            where=self._where,
            got=self.last_error,
            hint="steps that go on in the background are not supported"
            if word == "Pending"
            else None,
            component=self.name,
            call=call,
        )

    def _abandon_all(self, status: int) -> None:
        """After Fatal, stop calling all instances of this FMU in the same process."""
        if status == FATAL:
            self._fatal = True
            for other in self._of_this_fmu_here():
                other._fatal = True  # noqa: SLF001 - of the same class

    def end(self, *, terminate: bool) -> None:
        """Free the instance and unload its library."""
        self.phase = "closed"
        if terminate:
            self._finish("terminating", self._fmu.terminate)
        if self._fmu is not None:
            if self.component:
                self._finish("freeing", self._fmu.freeInstance)  # and unloads
            else:
                self._finish("unloading", self._fmu.freeLibrary)
            if self._fatal:
                self._fmu.abandon()
        unregister_sink(self._environment)
        with _open_guard:
            _open_instances.discard(self)

    def _finish(self, what: str, call: Callable[[], Any]) -> None:
        """Make a call at the end, unless the FMU may not be called; a failure is logged."""
        if self._fatal or self._fmu.death is not None:  # terminating it may have shown that
            return
        try:
            call()
        except FMICallException as error:
            self._log("warning", f"{what} the slave: status {error.status}", "")
            self._abandon_all(error.status)
        except ComponentError as error:
            if error.kind is not None:
                self.end_failure = error
            found = error.got if error.kind is None else error.text()
            self._log("warning", f"{what} the slave: {found}", "")
        except OSError as error:
            self._log("warning", f"{what} the slave: {error}", "")
