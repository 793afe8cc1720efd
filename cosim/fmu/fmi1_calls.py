"""FMPy's slave of FMI 1.0, with the types that the standard gives its functions."""

from __future__ import annotations

from ctypes import c_int
from types import FunctionType
from typing import Any, Final

from fmpy.fmi1 import FMU1Slave

_STATUSES: Final = (
    *("fmi1InitializeSlave", "fmi1DoStep", "fmi1CancelStep", "fmi1GetStatus", "fmi1GetRealStatus"),
    *("fmi1GetIntegerStatus", "fmi1GetBooleanStatus", "fmi1GetStringStatus"),
    "fmi1GetRealOutputDerivatives",
)
"""Functions that return a status, which FMPy 0.3.32 declares to return a text: it takes every
refusal for an address, and reads there."""


def _with_status(name: str) -> Any:
    """Return FMPy's function of this name, declared to return a status."""
    declared = getattr(FMU1Slave, name)
    made = FunctionType(declared.__code__, declared.__globals__, name, declared.__defaults__)
    made.__annotations__ = {**declared.__annotations__, "return": c_int}
    return made


FMU1Calls: Final[Any] = type("FMU1Calls", (FMU1Slave,), {n: _with_status(n) for n in _STATUSES})
"""A class whose name begins with FMU1, as FMPy asks of classes for FMI 1.0."""
