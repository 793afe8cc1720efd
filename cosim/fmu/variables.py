"""Read and set the variables of an instance by name, where the standard allows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

from fmpy.fmi1 import FMICallException

from cosim.core import ComponentError, InputError
from cosim.fmu.description import FmuDescription
from cosim.fmu.instance import DISCARD, Instance
from cosim.fmu.port import PHASE_TEXT, Port, describe_settable, may_be_set
from cosim.fmu.values import checked_scalars, rounded_to_c, value_of

CheckedValue = tuple[Port, list[Any]]
"""A variable and the scalars to set it to."""
_UNCHANGEABLE = (float, int, bool, str)


class VariableAccess(Instance):
    """An instance whose variables are read and set by name."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given: list[CheckedValue] = []
        self._checked: dict[str, tuple[Any, CheckedValue]] = {}

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
            if port.kind in (None, "clock"):
                checked_scalars(port, None, self._input)
        found = {}
        for members in _by_type(ports):
            size = (sum(p.size for p in members),) if self.version == "3.0" else ()
            items = self._move("get", members, *size)
            first = 0
            for port in members:
                found[port.name] = value_of(port, items[first : first + port.size])
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
            self._do("entering configuration mode", "enterConfigurationMode")
            self._set(shaping)
            self._do("leaving configuration mode", "exitConfigurationMode")
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
            if begun != value_of(port, rounded_to_c(port, items)):
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
            before = self._checked.get(name)
            if self.phase == "instantiated" and before is not None and before[0] is value:
                prepared.append(before[1])  # after a reset
                continue
            port = description.port(name, where=self._input)
            # FMI 1.0 has no initialization mode: the slave is initialised when that is entered
            begun = self.version == "1.0" and self.phase == "initialising"
            phase = "stepping" if begun else self.phase
            if self.phase in PHASE_TEXT and not may_be_set(port, phase):
                raise InputError(
                    f"{name} cannot be set {PHASE_TEXT[self.phase]}",
                    where=self._input,
                    got=describe_settable(port),
                )
            prepared.append((port, checked_scalars(port, value, self._input)))
            if type(value) in _UNCHANGEABLE:  # the same object is the same value
                self._checked[name] = value, prepared[-1]
        return prepared

    def _set(self, prepared: Sequence[CheckedValue]) -> None:
        flat = {port.name: items for port, items in prepared}
        for members in _by_type([port for port, _ in prepared]):
            self._move("set", members, [x for port in members for x in flat[port.name]])

    def get_binaries(self, references: Sequence[int], size: int) -> tuple[int, list[bytes]]:
        """Return the status of reading variables of type Binary, and their values."""
        try:
            found = self._attempt("getBinary", list(references), size)
        except FMICallException as error:
            return error.status, []
        return 0, [raw or b"" for raw in found]

    def set_binaries(self, references: Sequence[int], values: Sequence[bytes]) -> int:
        """Set variables of type Binary and return the status."""
        try:
            self._attempt("setBinary", list(references), list(values))
        except FMICallException as error:
            return int(error.status)
        return 0

    def _move(self, way: Literal["get", "set"], ports: Sequence[Port], *arguments: Any) -> Any:
        """Get or set variables of one type; after a discarded value the slave can go on.

        A logged error counts as a refusal, because some exporters return OK with it.
        """
        references = [port.reference for port in ports]
        before, self._logged_error = self._logged_error, None
        status, items = 0, None
        try:
            items = self._attempt(f"{way}{ports[0].getter_type}", references, *arguments)
        except FMICallException as error:
            status = error.status
        if not status and self._logged_error is None:
            self._logged_error = before
            return items
        names = [port.name for port in ports]
        what = f"{'reading' if way == 'get' else 'setting'} {', '.join(names[:3])}"
        what += ", ..." if len(names) > 3 else ""
        phase = self.phase
        refusal = self.refused(what, status)
        if status == DISCARD:
            self.phase = phase
        raise refusal


def _by_type(ports: Sequence[Port]) -> list[list[Port]]:
    """Group ports by the C function that moves them, in order."""
    groups: dict[str, list[Port]] = {}
    for port in ports:
        groups.setdefault(port.getter_type, []).append(port)
    return list(groups.values())
