"""FMI calls that exchange a group of variables of any type between a slave and a row.

Calls go through cffi with plain addresses, which costs a third less than ctypes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Literal

import numpy as np
from _cffi_backend import FFI  # reads C types itself: no parser of C has to be loaded
from numpy.typing import NDArray

from cosim.fmu import ACCEPTED_STATUSES, restore_function, saved_float_mode
from cosim.master.component_instance import MOST_EXACT, ComponentInstance, Group, Rows

OK: Final = 0
TOO_LARGE: Final = 1 << 32
"""Not a status of FMI: the kernel has read an integer that no double is, and leaves the rest of the
run to the loop in Python. An FMU returns a C int, so that no status of one is this or greater."""

_FFI: Final = FFI()
_FORMS: Final = {
    **dict.fromkeys(("1.0", "2.0"), "int(*)(void *, void *, size_t, uintptr_t)"),
    "3.0": "int(*)(void *, void *, size_t, uintptr_t, size_t)",
}
_STEPS: Final = {
    "1.0": "int(*)(void *, double, double, uint8_t)",
    "2.0": "int(*)(void *, double, double, int)",
    "3.0": "int(*)(void *, double, double, _Bool, uintptr_t, uintptr_t, uintptr_t, uintptr_t)",
}


def exchange_function(version: str, address: int) -> Callable[..., int]:
    """Return the function fmi2Get..., fmi3Set..., ... at an address."""
    function: Any = _FFI.cast(_FORMS[version], address)
    return function  # type: ignore[no-any-return]


def step_function(version: str, address: int) -> Callable[..., int]:
    """Return the function fmi2DoStep or fmi3DoStep at an address."""
    function: Any = _FFI.cast(_STEPS[version], address)
    return function  # type: ignore[no-any-return]


def float_mode_restorer() -> Callable[[], object]:
    """Return what makes rounding and flush to zero as they are now."""
    restore: Any = _FFI.cast("int(*)(void *)", restore_function)
    saved = _FFI.from_buffer(saved_float_mode())
    return lambda: restore(saved)


def pointer(address: int) -> Any:
    """Return an address in the form that cffi passes fastest."""
    return _FFI.cast("void *", address)


def exchange_of(
    instance: ComponentInstance, group: Group, way: Literal["get", "set"]
) -> Callable[[Rows], int]:
    """Return what gets or sets a group in a row, and returns the status of the call."""
    if group.c_type != "V":
        return Exchange(instance, group, way)
    slave, texts, references = instance.slave, instance.texts, group.references.tolist()
    columns = slice(group.column, group.column + group.size)

    def get(row: Rows) -> int:
        status, values = slave.get_binaries(references, group.size)
        if status in ACCEPTED_STATUSES:
            row[columns] = texts.of_bytes(values)
        return status

    def give(row: Rows) -> int:
        values = [bytes.fromhex(texts.text(v)) for v in row[columns].tolist()]
        return slave.set_binaries(references, values)

    return get if way == "get" else give


class Exchange:
    """A get or set of a group; call it with the row.

    Attributes
    ----------
    scratch : the values in the group's own C type, (values,).
    """

    def __init__(
        self, instance: ComponentInstance, group: Group, way: Literal["get", "set"]
    ) -> None:
        slave = instance.slave
        address = slave.address(way, group.getter_type)
        self._function = exchange_function(slave.description.version, address)
        self._restore_float_mode = float_mode_restorer()
        self._references = group.references  # the arguments are addresses
        self._columns = slice(group.column, group.column + group.size)
        self._texts = instance.texts
        self._judge = slave.returned(way, group.getter_type)
        self._kept: Any = None
        text = group.c_type == "S"
        self.scratch: NDArray[Any] = np.zeros(group.size, "u8" if text else group.c_type)
        self._wide = group.c_type in ("i8", "u8")
        more = (group.size,) if slave.description.version == "3.0" else ()
        self._arguments = (
            pointer(slave.component),
            pointer(group.references.ctypes.data),
            group.references.size,
            self.scratch.ctypes.data,
            *more,
        )
        # not bound: a reference to itself would leave the object to the garbage collector
        self._move = {
            ("get", False): Exchange._get,
            ("set", False): Exchange._set,
            ("get", True): Exchange._get_texts,
            ("set", True): Exchange._set_texts,
        }[way, text]

    def __call__(self, row: Rows) -> int:
        """Exchange the values and return the status."""
        return self._move(self, row)

    def _call(self) -> int:
        status = self._function(*self._arguments)
        self._restore_float_mode()
        return status

    def _get(self, row: Rows) -> int:
        status = self._call()
        row[self._columns] = self.scratch
        if self._wide and status in ACCEPTED_STATUSES and not self._is_exact(self.scratch):
            row[self._columns] = self._texts.of_integers(self.scratch.tolist())
        return status

    @staticmethod
    def _is_exact(values: NDArray[Any]) -> bool:
        return bool(values.max(initial=0) <= MOST_EXACT and values.min(initial=0) >= -MOST_EXACT)

    def _set(self, row: Rows) -> int:
        values = row[self._columns]
        if self._wide and not self._is_exact(values):
            self.scratch[:] = [self._texts.integer(value) for value in values.tolist()]
        else:
            self.scratch[:] = values
        return self._call()

    def _get_texts(self, row: Rows) -> int:
        status = self._call()
        if status in ACCEPTED_STATUSES:
            row[self._columns] = [
                self._texts.number((self._judge.text(address) or b"").decode("utf-8", "replace"))
                for address in self.scratch.tolist()
            ]
        return status

    def _set_texts(self, row: Rows) -> int:
        self._kept = [
            _FFI.new("char[]", self._texts[int(number)].encode("utf-8"))
            for number in row[self._columns].tolist()
        ]
        self.scratch[:] = [int(_FFI.cast("uintptr_t", text)) for text in self._kept]
        return self._call()
