"""The messages between parent and child: plain tuples, pickled.

To the child: `(RUN, number, Job)`, followed by the file descriptor of the rows unless they are
there already, `(CLOSE, number)`, and `(CALL, number, folder, progress, function, arguments, each)`.
To the parent, each with the number of the run: see the names below.
"""

from __future__ import annotations

import copyreg
import pickle
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from types import MappingProxyType
from typing import Any, Final

from cosim.core import ComponentError, CosimError
from cosim.master.engine import EngineName
from cosim.master.session import Session
from cosim.master.supervision.shared import SharedRun
from cosim.master.system import System
from cosim.master.wiring import Wiring

RUN, CLOSE, CALL = "run", "close", "call"
BEGUN: Final = "begun"
"""engine choice: all slaves are initialised."""
LINE: Final = "line"
"""A log line, as `ObserverDispatch.add` takes it."""
DELIVER: Final = "deliver"
"""Number of complete rows: these, and the lines before them, are to be delivered."""
TEXT: Final = "text"
"""number, text: a new value that no double is."""
POINT: Final = "point"
"""Instant [ns] and [s] of a point that was added: a component has an event."""
SET: Final = "set"
"""name, instant [ns], value: what an event has set."""
WITHIN: Final = "within"
"""component, instants [ns], values: outputs within steps."""
CONDUCTED: Final = "conducted"
"""status, reason, cause, complete, engine choice, what `conduct` returned."""
RAISED: Final = "raised"
"""An exception and its traceback."""
CLOSED: Final = "closed"
"""All slaves are freed; cause and words of what ended the process of an isolated one, or None."""
CALLED: Final = "called"
"""What a function returned for the next things that it was called for, a list."""
PROCESS: Final = "process"
"""Number and memory [bytes] of the process of an isolated slave, before it loads anything."""


@dataclass(frozen=True)
class Job:
    """A run, for the child.

    Attributes
    ----------
    conduct : runs the session and returns what is to be known of it; picklable, both.
    keep : whether all rows stay in memory.
    call_limit : of one call of an isolated slave [s]; None: no limit.
    size : of the shared memory [bytes].
    folder : where FMUs are unpacked.
    wired : the wiring and its shared memory, if the child was forked when they were there.
    """

    system: System
    conduct: Callable[[Session], Any]
    call_limit: float | None
    engine: EngineName
    keep: bool
    size: int
    folder: str
    wired: tuple[Wiring, SharedRun] | None


class _Pickler(pickle.Pickler):
    dispatch_table = copyreg.dispatch_table.copy()
    dispatch_table[MappingProxyType] = lambda proxy: (_proxy, (dict(proxy),))
    known: Mapping[int, int]

    def persistent_id(self, thing: Any) -> int | None:
        """Return the number of an object that the child has; None for all others."""
        return self.known.get(id(thing))


class _Unpickler(pickle.Unpickler):
    known: Sequence[Any]

    def persistent_load(self, number: int) -> Any:
        """Return the object with a number."""
        return self.known[number]


def _proxy(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def packed(message: Any, known: Sequence[Any] = ()) -> bytes:
    """Pickle a message, read-only mappings included; objects in `known` are only referred to."""
    stream = BytesIO()
    pickler = _Pickler(stream, pickle.HIGHEST_PROTOCOL)
    pickler.known = {id(thing): number for number, thing in enumerate(known)}
    pickler.dump(message)
    return stream.getvalue()


def unpacked(data: bytes, known: Sequence[Any] = ()) -> Any:
    """Return the message; `known` as in `packed`."""
    unpickler = _Unpickler(BytesIO(data))
    unpickler.known = known
    return unpickler.load()


def exception_parts(error: BaseException) -> tuple[Any, str]:
    """Return an exception in a form that can be sent, and its traceback as text."""
    trace = "".join(traceback.format_exception(error))
    if isinstance(error, CosimError):
        keys = ["where", "expected", "got", "hint"]
        if isinstance(error, ComponentError):
            keys += ["kind", "component", "call", "detail"]
        kind = next(c for c in type(error).__mro__ if c.__module__ == CosimError.__module__)
        return (kind, error.what, {key: getattr(error, key) for key in keys}), trace
    return (CosimError, f"unexpected {type(error).__name__}: {error}", {}), trace


def exception_of(parts: Any) -> CosimError:
    """Return the exception that was sent."""
    kind, what, more = parts
    return kind(what, **more)  # type: ignore[no-any-return]
