"""One instance of an FMU: load it, call its functions, take its messages, free it."""

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
from cosim.fmu.port import Phase
from cosim.fmu.unpacking import unpack_fmu

WARNING, DISCARD, ERROR, FATAL = 1, 2, 3, 4
"""fmi2Status and fmi3Status; 0 is OK."""
_STATUS: Final = MappingProxyType({2: "Discard", 3: "Error", 4: "Fatal", 5: "Pending"})
_CLAIM: Final = "logStatus"
"""Prefix of the standard's log categories for the status of a call. Some exporters, PythonFMU among
them, log an error there and return OK: the message counts. Errors in other categories do not, since
some tools log their progress as errors."""
_PYTHONFMU: Final = "slavemodule.txt"
"""A file that PythonFMU puts into the resources. PythonFMU passes messages as formats without
arguments: formatting a per cent sign would read memory at random, or crash. And it reports every
failed step as a slave that asks for the end."""
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
    phase : of its life cycle.
    last_error : the last message with a status beyond Warning since the last call from here.
    _logged_error : the last message that counts as an error of the present call.
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
        """Return the address of fmiNGet... or fmiNSet... for a type, or of fmiNDoStep.

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
        """Call an FMI function, named without prefix, with this instance.

        Raises
        ------
        ComponentError : a status beyond Warning, or a call after the end.
        """
        status = self.status_of(function, *arguments)
        if status > WARNING:
            raise self.refused(what, status)

    def status_of(self, function: str, *arguments: Any) -> int:
        """Call an FMI function with this instance and return its status."""
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
        """Return the error of a refused call; only `close` is allowed after it.

        After Fatal no instance of the FMU may be called.
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
        """Stop calling this instance: one of the same FMU has returned Fatal."""
        self._fatal = True

    def end(self, *, terminate: bool) -> None:
        """Free the instance and unload its library."""
        self.phase = "closed"
        try:
            if terminate and not self._fatal:
                status = self._binary.function("Terminate")(self.component)
                if status > WARNING:
                    self._log("warning", f"terminating the slave: status {status}", "")
            if not self._fatal:  # Terminate may have called `abandon`
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
