"""Read and set the variables of an instance by name, where the standard allows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from cosim.core import ComponentError, InputError
from cosim.fmu.description import FmuDescription
from cosim.fmu.instance import DISCARD, WARNING, Instance
from cosim.fmu.port import PHASE_TEXT, Port, describe_settable, may_be_set
from cosim.fmu.values import address_of, checked_scalars, empty_array, from_c, to_c

CheckedValue = tuple[Port, list[Any]]
"""A variable and the scalars to set it to."""


class VariableAccess(Instance):
    """An instance whose variables are read and set by name."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given: list[CheckedValue] = []

    @property
    def _input(self) -> str:
        """The place that messages about wrong input name."""
        return f"component {self.name!r}"

    def read(self, names: Iterable[str]) -> dict[str, Any]:
        """Read variables: numbers, truth values or texts, nested lists of them for arrays.

        Raises
        ------
        InputError : an unknown variable or type, or before the initialisation.
        ComponentError : the slave refuses.
        """
        ports = [self.description.port(name, where=self._input) for name in names]
        if self.phase == "instantiated":
            raise InputError(
                "nothing can be read before the initialisation",
                where=self._input,
                got=", ".join(p.name for p in ports) or None,
            )
        for port in ports:
            if port.kind is None:
                checked_scalars(port, None, self._input)
        found = {}
        for members in _by_type(ports):
            array = empty_array(members[0].c_type, sum(p.size for p in members))
            self._move("Get", members, array)
            first = 0
            for port in members:
                found[port.name] = from_c(port, array, first)
                first += port.size
        return {port.name: found[port.name] for port in ports}

    def set_start(self, parameters: Mapping[str, Any]) -> None:
        """Set parameters and start values; structural parameters first, in configuration mode.

        Raises
        ------
        InputError : an unknown variable, one that cannot be set, a value that does not fit.
        ComponentError : the slave refuses.
        """
        for name in parameters:
            self.description.port(name, where=self._input)
        resized = self.description.resized(parameters)
        prepared = self._prepared(parameters, resized)
        shaping = [p for p in prepared if p[0].causality == "structuralParameter"]
        if shaping:
            self.call("entering configuration mode", "EnterConfigurationMode")
            self._set(shaping)
            self.call("leaving configuration mode", "ExitConfigurationMode")
        self.description = resized
        self._set([p for p in prepared if p[0].causality in ("parameter", "input")])
        for port, items in prepared:
            if port.causality in ("output", "local", "calculatedParameter"):
                self._set_computed(port, items)

    def _set_computed(self, port: Port, items: list[Any]) -> None:
        """Set a start value of a variable that the FMU computes; some FMUs refuse it wrongly."""
        try:
            self._set([(port, items)])
        except ComponentError as error:
            raise self._not_taken(port, error.got or "no message") from error
        if port.initial == "exact":
            self._given.append((port, items))

    def _check_taken(self) -> None:
        """Check that the slave starts with the exact start values that it was given."""
        for port, items in self._given:
            begun = self.read([port.name])[port.name]
            if begun != from_c(port, to_c(port.c_type, items), 0):
                raise self._not_taken(port, f"it starts with {begun}, given {items}")
        self._given.clear()

    def _not_taken(self, port: Port, reason: str) -> InputError:
        return InputError(
            f"{port.name} cannot be set",
            where=self._input,
            expected=f"a start value that the FMU takes; this is of causality {port.causality}",
            got=reason,
        )

    def write(self, values: Mapping[str, Any]) -> None:
        """Set variables; nothing is set if one value does not fit.

        Raises
        ------
        InputError : an unknown variable, one that cannot be set now, or a value that does not fit.
        ComponentError : the slave refuses.
        """
        if self.phase == "instantiated":
            self.set_start(values)
        else:
            self._set(self._prepared(values, self.description))

    def _prepared(
        self, values: Mapping[str, Any], description: FmuDescription
    ) -> list[CheckedValue]:
        prepared = []
        for name, value in values.items():
            port = description.port(name, where=self._input)
            if self.phase in PHASE_TEXT and not may_be_set(port, self.phase):
                raise InputError(
                    f"{name} cannot be set {PHASE_TEXT[self.phase]}",
                    where=self._input,
                    got=describe_settable(port),
                )
            prepared.append((port, checked_scalars(port, value, self._input)))
        return prepared

    def _set(self, prepared: Sequence[CheckedValue]) -> None:
        flat = {port.name: items for port, items in prepared}
        for members in _by_type([port for port, _ in prepared]):
            array = to_c(members[0].c_type, [x for port in members for x in flat[port.name]])
            self._move("Set", members, array)

    def _move(self, way: Literal["Get", "Set"], ports: Sequence[Port], array: Any) -> None:
        """Get or set variables of one type; after a discarded value the slave can go on.

        A logged error counts as a refusal, because some exporters return OK with it.
        """
        references = np.array([port.reference for port in ports], np.uint32)
        sizes = (len(array),) if self.version == "3.0" else ()
        at = (address_of(references), references.size, address_of(array), *sizes)
        before, self._logged_error = self._logged_error, None
        status = self.status_of(f"{way}{ports[0].getter_type}", *at)
        if status <= WARNING and self._logged_error is None:
            self._logged_error = before
            return
        names = [port.name for port in ports]
        what = f"{'reading' if way == 'Get' else 'setting'} {', '.join(names[:3])}"
        what += ", ..." if len(names) > 3 else ""
        phase = self.phase
        error = self.refused(what, status)
        if status == DISCARD:
            self.phase = phase
        raise error


def _by_type(ports: Sequence[Port]) -> list[list[Port]]:
    """Group ports by the C function that moves them, in order."""
    groups: dict[str, list[Port]] = {}
    for port in ports:
        groups.setdefault(port.getter_type, []).append(port)
    return list(groups.values())
