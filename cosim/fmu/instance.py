"""One instance of an FMU: loaded, called, heard and freed; what its calls mean is the slave's."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from types import MappingProxyType
from typing import Any, Final, Literal
from weakref import WeakSet

from cosim.core import ComponentError, InputError
from cosim.fmu.binary import PREFIX, load_binary
from cosim.fmu.description import FmuDescription
from cosim.fmu.messages import (
    LEVELS,
    LogSink,
    fmi2_callbacks,
    fmi3_logger,
    register_sink,
    unregister_sink,
    with_names,
)
from cosim.fmu.phase import Phase
from cosim.fmu.unpacking import unpack_fmu

WARNING, DISCARD, ERROR, FATAL = 1, 2, 3, 4
"""fmi2Status and fmi3Status; 0 is OK."""
_STATUS: Final = MappingProxyType({2: "Discard", 3: "Error", 4: "Fatal", 5: "Pending"})
_CLAIM: Final = "logStatus"
"""How the standard's categories begin that say what a call returns. Some exporters, PythonFMU
among them, cannot return what they say there, so it is believed. An error in another category
claims nothing: there are tools that log their progress so."""
_PYTHONFMU: Final = "slavemodule.txt"
"""What PythonFMU puts into the resources. It hands its messages on as if they were formats: a
per cent sign in one would be followed by what happens to lie in memory, or by a crash. And every
step that it could not make it calls the end that the slave wants."""
_CO_SIMULATION = 1
_open_instances: WeakSet[Instance] = WeakSet()


class Instance:
    """An instance between instantiation and the end.

    Attributes
    ----------
    name : of the component.
    description : of the FMU; array shapes follow the structural parameters once they are set.
    version : of FMI.
    component : address of the instance.
    phase : where it stands.
    last_error : the last message with a status beyond Warning since the last call from here.
    _logged_error : the last message that claims an error, until the call that it belongs to is
    over.
    """

    def __init__(
        self,
        description: FmuDescription,
        name: str,
        log: LogSink,
        *,
        categories: Sequence[str] | None = None,
    ) -> None:
        self.name = name
        self.description = description
        self.version = description.version
        self.phase: Phase = "instantiated"
        self.last_error: str | None = None
        self.component = 0
        self._logged_error: str | None = None
        self._log = log
        self._categories = categories
        self._fatal = False
        self._where = f"component {name!r} ({description.path.name})"
        self._check_categories()
        self._check_alone()
        folder = unpack_fmu(description)
        self._resources = folder / "resources"
        self._of_pythonfmu = (self._resources / _PYTHONFMU).is_file()
        self._binary = load_binary(description, folder, name)
        self._environment = register_sink(name, self._on_message)
        try:
            self._instantiate()
        except BaseException:
            self.end(terminate=False)
            raise
        _open_instances.add(self)
        for departure in description.departures:
            self._log("warning", f"modelDescription.xml: {departure}", "")

    def _check_categories(self) -> None:
        known = {category.name for category in self.description.model.logCategories}
        for category in self._categories or ():
            if category not in known:
                raise InputError.unknown("log category", category, known, where=self._where)

    def _check_alone(self) -> None:
        if not self.description.can_be_instantiated_only_once:
            return
        for other in _open_instances:
            if other.description.sha256 == self.description.sha256 and other.phase != "closed":
                raise InputError(
                    "this FMU can be instantiated only once in a process",
                    where=self._where,
                    got=f"component {other.name!r} is an instance of it",
                    hint="one component of it per run; runs in processes of their own",
                )

    def _instantiate(self) -> None:
        create = self._create_fmi2 if self.version == "2.0" else self._create_fmi3
        try:
            self.component = int(create() or 0)
        except AttributeError as error:
            raise self._lacks(error) from error
        if not self.component:
            model = self.description.model
            tool = self.description.needs_execution_tool
            raise ComponentError(
                "the FMU refuses to be instantiated",
                where=self._where,
                got=self.last_error or "no message",
                hint=f"it needs a program to run in, made by: {model.generationTool or 'not said'}"
                if tool
                else None,
            )
        self.last_error = self._logged_error = None
        if self._categories is not None:
            names = [category.encode() for category in self._categories]
            array = (ctypes.c_char_p * len(names))(*names)
            self.call("choosing log categories", "SetDebugLogging", bool(names), len(names), array)

    def _create_fmi2(self) -> int | None:
        self._callbacks = fmi2_callbacks(self._environment, formats=not self._of_pythonfmu)
        found: int | None = self._binary.function("Instantiate")(
            self.name.encode(),
            _CO_SIMULATION,
            self.description.model.guid.encode(),
            self._resources.as_uri().encode(),
            ctypes.byref(self._callbacks),
            0,
            int(self._categories is None or bool(self._categories)),
        )
        return found

    def _create_fmi3(self) -> int | None:
        event_mode = early_return = visible = False
        found: int | None = self._binary.function("InstantiateCoSimulation")(
            self.name.encode(),
            self.description.model.instantiationToken.encode(),
            f"{self._resources}{os.sep}".encode(),
            visible,
            self._categories is None or bool(self._categories),
            event_mode,
            early_return,
            None,
            0,
            self._environment,
            ctypes.cast(fmi3_logger, ctypes.c_void_p),
            None,
        )
        return found

    def _on_message(self, status: int, category: str, message: str) -> None:
        if self.version == "2.0" and "#" in message:
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
        """Address of fmiNGet..., fmiNSet... for variables of a type, or of fmiNDoStep.

        Raises
        ------
        ComponentError : the FMU has no such function.
        """
        name = {"get": f"Get{getter_type}", "set": f"Set{getter_type}", "step": "DoStep"}[way]
        try:
            return self._binary.address(name)
        except AttributeError as error:
            raise self._lacks(error) from error

    def call(self, what: str, function: str, *arguments: Any) -> None:
        """Call an FMI function, named without prefix, on this instance.

        Raises
        ------
        ComponentError : a status beyond Warning, or nothing may be called any more.
        """
        status = self.status_of(function, *arguments)
        if status > WARNING:
            raise self.refused(what, status)

    def status_of(self, function: str, *arguments: Any) -> int:
        """The status that an FMI function returns for this instance."""
        if self._fatal or self.phase in ("failed", "closed"):
            raise ComponentError(
                f"{PREFIX[self.version]}{function} is called after the end",
                where=self._where,
                expected="nothing but close",
                got=self.last_error,
            )
        self.last_error = None
        try:
            return int(self._binary.function(function)(self.component, *arguments))
        except AttributeError as error:
            raise self._lacks(error) from error

    def refused(self, what: str, status: int) -> ComponentError:
        """The error that a refusal stands for; only `close` is allowed after it.

        After Fatal no instance of the FMU is called any more.
        """
        self.phase = "failed"
        if status == FATAL:
            for other in _open_instances:
                if other.description.sha256 == self.description.sha256:
                    other.abandon()
        word = _STATUS.get(status)
        returned = f"returned {PREFIX[self.version]}{word}" if word else f"returned status {status}"
        if status <= WARNING:
            returned = "logged an error"
        return ComponentError(
            f"{what} {returned}",
            where=self._where,
            got=self.last_error,
            hint="steps that go on in the background are not supported"
            if word == "Pending"
            else None,
        )

    def abandon(self) -> None:
        """Call nothing of this instance any more: one of its FMU has reported Fatal."""
        self._fatal = True

    def end(self, *, terminate: bool) -> None:
        """Give the instance and its library back."""
        self.phase = "closed"
        try:
            if terminate and not self._fatal:
                status = self._binary.function("Terminate")(self.component)
                if status > WARNING:
                    self._log("warning", f"terminating the slave: status {status}", "")
            if not self._fatal:  # it may have died in the meantime
                if self.component:
                    self._binary.function("FreeInstance")(self.component)
                self._binary.unload()
        except (AttributeError, OSError) as error:
            self._log("warning", f"freeing the slave: {error}", "")
        finally:
            unregister_sink(self._environment)
            _open_instances.discard(self)

    def _lacks(self, error: AttributeError) -> ComponentError:
        return ComponentError(
            "the FMU lacks a function that the standard asks for",
            where=self._where,
            got=str(error),
        )
