"""The messages between the process of the master and that of an isolated slave, pickled tuples.

To the slave: `(number, method, arguments, options)`: a method of FMPy's slave, or one of the
server.
To the master, in order: see the names below.
"""

from __future__ import annotations

import copyreg
import pickle
from ctypes import c_void_p
from io import BytesIO
from typing import Any, Final

from fmpy.fmi1 import FMICallException

READY: Final = "ready"
"""The process is there."""
LINE: Final = "line"
"""status, category, message: a log line of the FMU, as a `MessageSink` takes it."""
BEGIN, END = "begin", "end"
"""name of a call: a call that is none of the loop begins; it has returned."""
RETURNED: Final = "returned"
"""number, result of a method."""
RAISED: Final = "raised"
"""number, exception of a method."""


def _refusal(function: str, status: int) -> FMICallException:
    return FMICallException(function=function, status=status)


class _Pickler(pickle.Pickler):
    dispatch_table = copyreg.dispatch_table.copy()
    dispatch_table[c_void_p] = lambda one: (c_void_p, (one.value,))
    dispatch_table[FMICallException] = lambda one: (_refusal, (one.function, one.status))


def packed(*message: Any) -> bytes:
    """Pickle a message: states of FMUs are sent as the addresses that they are."""
    stream = BytesIO()
    _Pickler(stream, pickle.HIGHEST_PROTOCOL).dump(message)
    return stream.getvalue()


def unpacked(data: bytes) -> Any:
    """Return the message."""
    return pickle.loads(data)  # noqa: S301 - from our own other process
