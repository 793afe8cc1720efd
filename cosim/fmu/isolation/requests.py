"""The messages between the process of the master and that of an isolated slave.

What the slave says is one of the `FromSlave`s and nothing else: it runs foreign code. What it is
asked for is pickled in an `Asked`: a method of FMPy's slave, or one of the server.
"""

from __future__ import annotations

import copyreg
import pickle
from collections.abc import Mapping
from ctypes import c_void_p
from io import BytesIO
from typing import Any

import msgspec
from fmpy.fmi1 import FMICallException

from cosim.core import RaisedError


class _Pickler(pickle.Pickler):
    dispatch_table = copyreg.dispatch_table.copy()
    dispatch_table[c_void_p] = lambda one: (c_void_p, (one.value,))  # states of FMUs


class Asked(msgspec.Struct, array_like=True):
    """To the slave: number, method, arguments and options, pickled."""

    content: bytes

    @classmethod
    def of(
        cls, number: int, method: str, arguments: tuple[Any, ...], options: Mapping[str, Any]
    ) -> Asked:
        """Return the message."""
        stream = BytesIO()
        _Pickler(stream).dump((number, method, arguments, dict(options)))
        return cls(stream.getvalue())

    def parts(self) -> tuple[int, str, tuple[Any, ...], dict[str, Any]]:
        """Return what was given to `of`."""
        found: tuple[int, str, tuple[Any, ...], dict[str, Any]] = pickle.loads(self.content)  # noqa: S301 - from who asks
        return found


class FromSlave(msgspec.Struct, array_like=True, tag=True):
    """From the slave, in order."""


class Ready(FromSlave):
    """The process is there."""


class Line(FromSlave):
    """A log line of the FMU, as a `MessageSink` takes it."""

    status: int
    category: str
    message: str


class CallBegun(FromSlave):
    """A call begins that is none of the loop; its name."""

    call: str


class CallEnded(FromSlave):
    """It has returned."""


class MethodReturned(FromSlave):
    """The result of a method."""

    number: int
    result: Any


class Refused(FromSlave):
    """A method has ended with a status of FMI that means failure."""

    number: int
    function: str
    status: int

    def exception(self) -> Exception:
        """Return what FMPy raises."""
        found: Exception = FMICallException(function=self.function, status=self.status)
        return found


class Null(FromSlave):
    """A method has got NULL where the FMU owes an instance."""

    number: int
    words: str

    def exception(self) -> Exception:
        """Return what FMPy raises: a bare Exception."""
        return Exception(self.words)


class Raised(FromSlave):
    """A method has raised another exception."""

    number: int
    error: RaisedError

    def exception(self) -> Exception:
        """Return it."""
        found: Exception = self.error.error()
        return found


def failure(number: int, error: Exception) -> Refused | Null | Raised:
    """Return the message that tells an exception of a method."""
    if isinstance(error, FMICallException):
        return Refused(number, error.function, error.status)
    if type(error) is Exception:
        return Null(number, str(error))
    return Raised(number, RaisedError.of(error))


Answer = MethodReturned | Refused | Null | Raised
Message = Ready | Line | CallBegun | CallEnded | MethodReturned | Refused | Null | Raised
