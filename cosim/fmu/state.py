"""Save, restore, free and serialise states of an instance."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import partial
from typing import Any

from cosim.core import InputError
from cosim.fmu.port import Phase
from cosim.fmu.variables import VariableAccess


@dataclass(eq=False, slots=True)
class FmuState:
    """A saved state, which belongs to the instance that saved it.

        >>> from cosim import DelaySystem, pack
        >>> from cosim.fmu import FmuSlave, describe_fmu
        >>> lag = describe_fmu(pack(DelaySystem([[-1]]), "lag.fmu"))
        >>> with FmuSlave(lag, "lag", log=print) as slave:
        ...     slave.initialise({"initial.x[1]": 1.0}, 0.0, 10.0)
        ...     state = slave.snapshot()
        ...     slave.step(0.0, 1.0)
        ...     slave.restore(state)
        ...     slave.read(["x[1]"]), state.phase, state.freed
        ({'x[1]': 1.0}, 'stepping', False)

    Attributes
    ----------
    pointer : the FMU's own handle; null once it is freed.
    phase : of the instance when it was saved.
    event_mode : whether it was in event mode then.
    """

    pointer: ctypes.c_void_p
    phase: Phase
    event_mode: bool = False

    @property
    def freed(self) -> bool:
        """Whether it has been freed."""
        return not self.pointer


class StateAccess(VariableAccess):
    """An instance whose state can be saved and restored, if its FMU supports that."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._states: list[FmuState] = []

    def snapshot(self) -> FmuState:
        """Save the whole state of the slave; free it when it is not needed any more.

        Raises
        ------
        InputError : the FMU cannot do that.
        ComponentError : the slave refuses.
        """
        self._check_capable(
            able=self.description.can_get_and_set_state, flag="canGetAndSetFMU{}tate"
        )
        return self._kept(self._do("saving the state", self._stateful("get{}")))

    def restore(self, state: FmuState) -> None:
        """Return to a saved state, which stays saved."""
        self._check_own(state)
        self._do("restoring a state", self._stateful("set{}"), state.pointer)
        self.phase = state.phase

    def free(self, state: FmuState) -> None:
        """Free a saved state; freeing it again does nothing."""
        if not state.freed:
            self._check_own(state)
            self._do("freeing a state", self._stateful("free{}"), state.pointer)
            state.pointer = ctypes.c_void_p()
            self._states.remove(state)

    def serialise(self, state: FmuState) -> bytes:
        """Return a saved state as bytes."""
        self._check_serialises()
        self._check_own(state)
        content: bytes = self._do(
            "serialising a state", self._stateful("serialize{}"), state.pointer
        )
        return content

    def deserialise(self, content: bytes) -> FmuState:
        """Make a saved state from the bytes of one of the same FMU, saved in the same phase."""
        self._check_serialises()
        name = "deSerializeFMUstate" if self.version == "2.0" else "deserializeFMUState"
        return self._kept(self._do("reading a state", name, content))

    def _stateful(self, name: str) -> str:
        return name.format("FMUstate" if self.version == "2.0" else "FMUState")

    def _kept(self, pointer: ctypes.c_void_p) -> FmuState:
        state = FmuState(pointer, self.phase)
        self._states.append(state)
        return state

    def _check_own(self, state: FmuState) -> None:
        if state not in self._states:
            raise InputError(
                "this state is not one of the slave's",
                where=self._input,
                got="a state that was freed" if state.freed else "a state of another slave",
            )

    def _check_serialises(self) -> None:
        able = self.description.can_get_and_set_state and self.description.can_serialize_state
        self._check_capable(able=able, flag="canSerializeFMU{}tate")

    def _check_capable(self, *, able: bool, flag: str) -> None:
        if not able:
            letter = "s" if self.version == "2.0" else "S"
            is_old = self.version == "1.0"
            raise InputError(
                "this FMU cannot save and restore its state",
                where=self._where,
                expected=f"the capability {flag.format(letter)}"
                if not is_old
                else "an FMU of FMI 2.0 or 3.0",
                got="FMI 1.0, which has no call for it" if is_old else None,
            )

    def _free_all(self) -> None:
        """Free every saved state, before the instance is freed."""
        for state in self._states:
            free = getattr(self._fmu, self._stateful("free{}"))
            self._finish("freeing a state of", partial(free, state.pointer))
            state.pointer = ctypes.c_void_p()
        self._states.clear()
