"""The messages between a process and the child that executes its runs.

What the child says is one of the `FromChild`s and nothing else: it runs foreign code. What it is
told is pickled in a `Command`: it is a part of this process that only lives elsewhere.
"""

from __future__ import annotations

import copyreg
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from types import MappingProxyType
from typing import Any, Literal

import msgspec

from cosim.core import RaisedError
from cosim.master.engine import EngineChoice, EngineName
from cosim.master.run import RunStatus
from cosim.master.session import Session
from cosim.master.supervision.shared import SharedRun
from cosim.master.system import System
from cosim.master.wiring import Wiring
from cosim.trace.outcome import Cause


class Command(msgspec.Struct, array_like=True):
    """To the child: a `Job`, a `Request`, a `Close` or a `Call`, pickled."""

    content: bytes


class FromChild(msgspec.Struct, array_like=True, tag=True):
    """From the child: `run` is the number of what it is about."""

    run: int


class Begun(FromChild):
    """All slaves are initialised."""

    engine: EngineChoice


class Line(FromChild):
    """A log line, as `ObserverDispatch.add` takes it."""

    line: tuple[int, int, int, str, str, str]


class Deliver(FromChild):
    """So many rows are complete, and their sum; these and the lines before can be delivered."""

    complete: int
    row_sum: int


class Text(FromChild):
    """A new value that no double is, under its number."""

    number: int
    text: str


class Points(FromChild):
    """Points that were added, where components have events, from an index on; as bytes."""

    first: int
    instants_ns: bytes
    seconds: bytes


class EventValue(FromChild):
    """What an event has set."""

    name: str
    instant_ns: int
    value: float


class Within(FromChild):
    """What the outputs of a component were within steps: int64 [ns], and doubles."""

    component: str
    times_ns: bytes
    values: bytes


class SlaveStarted(FromChild):
    """The process of an isolated slave, before it loads anything: its number, its memory [bytes].

    None : unknown.
    """

    process: int
    memory: int | None


class Conducted(FromChild):
    """A run is over; `found` : what `conduct` returned."""

    status: RunStatus
    reason: str | None
    cause: Cause | None
    complete: int
    engine: EngineChoice
    found: Any


class Answer(FromChild):
    """What a request of a session has led to; `state` : how the session stands then."""

    found: Any
    state: SessionState


class SessionState(msgspec.Struct, array_like=True):
    """How a session stands; see the attributes of `Session`."""

    time_ns: int
    rows: int
    status: RunStatus | Literal["running"] | None
    reason: str | None
    cause: Cause | None
    end_reason: str


class Raised(FromChild):
    """An exception, and how a session stands then."""

    error: RaisedError
    state: SessionState | None = None


class Closed(FromChild):
    """All slaves are freed.

    failure : cause and words of what ended the process of an isolated one.
    leaves : the child is not what it was before, and leaves: the next run has another one.
    """

    failure: tuple[Cause, str] | None
    leaves: bool


class Called(FromChild):
    """What a function returned for the next things that it was called for."""

    results: list[Any]


Message = (
    Begun
    | Line
    | Deliver
    | Text
    | Points
    | EventValue
    | Within
    | SlaveStarted
    | Conducted
    | Answer
    | Raised
    | Closed
    | Called
)


@dataclass(frozen=True)
class Job:
    """A run, for the child; its shared memory comes with it, unless it has that.

    Attributes
    ----------
    conduct : runs the session and returns what is to be known of it; None: it serves `Request`s.
    make : makes the session, called as `Session`.
    keep : whether all rows stay in memory.
    call_limit : of one call of an isolated slave [s]; None: no limit.
    size : of the shared memory [bytes].
    folder : where FMUs are unpacked.
    wired : the wiring and its shared memory, if the child was forked when they were there.
    """

    run: int
    system: System
    conduct: Callable[[Session], Any] | None
    make: Callable[..., Session]
    call_limit: float | None
    engine: EngineName
    keep: bool
    size: int
    folder: str
    wired: tuple[Wiring, SharedRun] | None


@dataclass(frozen=True)
class Request:
    """A call of a function with the session of a run and more arguments."""

    run: int
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Close:
    """The slaves of a run are to be ended."""

    run: int


@dataclass(frozen=True)
class Call:
    """A call of a function for each of some things, its last argument."""

    run: int
    folder: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    each: Sequence[Any]


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


def packed(content: Job | Request | Close | Call, known: Sequence[Any] = ()) -> Command:
    """Return the message to the child; objects in `known` are only referred to."""
    stream = BytesIO()
    pickler = _Pickler(stream, pickle.HIGHEST_PROTOCOL)
    pickler.known = {id(thing): number for number, thing in enumerate(known)}
    pickler.dump(content)
    return Command(stream.getvalue())


def unpacked(message: Command, known: Sequence[Any] = ()) -> Any:
    """Return what the child is to do; `known` as in `packed`."""
    unpickler = _Unpickler(BytesIO(message.content))
    unpickler.known = known
    return unpickler.load()
