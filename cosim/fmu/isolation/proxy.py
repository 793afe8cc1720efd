"""An isolated slave as the process of the master sees it: with the methods of FMPy's slaves."""

from __future__ import annotations

import contextlib
import ctypes
import time
import weakref
from collections.abc import Callable, Mapping
from ctypes import c_char_p, c_uint32, c_void_p
from functools import partial
from itertools import count
from types import MappingProxyType
from typing import Any, Final

import msgspec
from _cffi_backend import FFI  # reads C types itself: no parser of C has to be loaded
from fmpy.fmi1 import FMICallException

from cosim.core import DEATH_HINTS, ComponentError, FrameError, death_of
from cosim.fmu.binary import ClockInterval, Loadable
from cosim.fmu.call_watch import calling
from cosim.fmu.isolation.channel import GONE, channel_library
from cosim.fmu.isolation.process import TICK_S, SlaveProcess
from cosim.fmu.isolation.requests import (
    Answer,
    Asked,
    CallBegun,
    CallEnded,
    Line,
    MethodReturned,
    Null,
    Raised,
    Refused,
)
from cosim.fmu.messages import sink_of
from cosim.fmu.returned import RawInterval

_LIMIT_HINT: Final = "a greater limits.call, for this run or in the scenario; none for no limit"
_PATIENCE_S: Final = 1.0
_FFI: Final = FFI()
_LOOK: Final = "int(int64_t)"
_TEXT_FUNCTIONS: Final = MappingProxyType(
    {
        **dict.fromkeys(("fmi1", "fmi2"), "int(void *, uintptr_t, size_t, uintptr_t)"),
        "fmi3": "int(void *, uintptr_t, size_t, uintptr_t, size_t)",
    }
)

_MUTE: Final = "the process of the component has closed its connection to this program"
_STRANGE: Final = "the process of the component sent what is no message of this program"
_Times = tuple[float, list[float]]
_RESULTS: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "getReal": list[float],
        "getInteger": list[int],
        "getBoolean": list[bool | int],
        "getString": list[bytes | None],
        "getBinary": list[bytes | None],
        "getClock": list[bool | int],
        **{f"getFloat{bits}": list[float] for bits in (32, 64)},
        **{f"get{u}Int{bits}": list[int] for u in ("", "U") for bits in (8, 16, 32, 64)},
        "doStep": tuple[bool, bool, bool, float] | None,
        "updateDiscreteStates": tuple[bool, bool, bool, bool, bool, float],
        "intervals": list[ClockInterval],
        "shifts": list[RawInterval],
        "taken": list[_Times],
        "getRealStatus": float,
        "getBooleanStatus": bool | int,
        **{f"{what}FMU{s}tate": c_void_p for what in ("get", "deSerialize") for s in "sS"},
        "deserializeFMUState": c_void_p,
        "serializeFMUstate": bytes,
        "serializeFMUState": bytes,
    }
)
"""What methods of FMPy's slaves return; what others do nobody looks at."""


class Death:
    """How the process of an isolated slave ended, and in which call.

    Parameters
    ----------
    kind : as of the cause of a run: crashed, exited, timed-out, interrupted.
    words : what happened.
    interruption : the exception that ended it: Ctrl-C while it was waited for.
    """

    def __init__(
        self,
        slave: IsolatedSlave,
        kind: str,
        words: str,
        call: str | None,
        interruption: BaseException | None = None,
    ) -> None:
        self._where, self._component = slave.where, slave.instanceName
        self._kind, self._words, self._call = kind, words, call
        self._interruption = interruption

    def error(self, what: str = "") -> ComponentError:
        """Return the error that says it; `what` was asked for.

        Raises
        ------
        BaseException : the interruption, if it was one.
        """
        if self._interruption is not None:
            raise self._interruption
        place = "" if self._call is None else f" in {self._call}"
        place += f" ({what})" if what else ""
        return ComponentError(
            f"{self._words}{place}",
            where=self._where,
            hint=_LIMIT_HINT if self._kind == "timed-out" else DEATH_HINTS.get(self._kind),
            kind=self._kind,
            component=self._component,
            call=self._call,
            detail=self._words,
        )


class IsolatedSlave:
    """FMPy's slave of an FMU in another process.

    Every method of FMPy's slave is one here, and is called there. `address` gives proxies with the
    signatures of FMI, and `component` what they take as the instance; for Strings the proxies are
    in Python. One thread at a time may use it.

    Raises
    ------
    ComponentError : see `load_slave`; from every method: the process has ended.

    Attributes
    ----------
    where, instanceName : as of `CheckedCalls`.
    death : how the process ended; None while it lives, and after `freeInstance`.
    false_text : why a String of the last exchange is not believed.
    """

    def __init__(self, process: SlaveProcess, binary: Loadable, component: str, where: str) -> None:
        self.where, self.instanceName = where, component
        self.death: Death | None = None
        self.false_text: ComponentError | None = None
        self._process, self._library = process, channel_library()
        this = weakref.ref(self)  # a reference to itself would leave it to the garbage collector
        self._kept: list[Any] = []  # the addresses of functions point to these
        look = self._callback(_LOOK, lambda waited_ns: _looked(this, waited_ns), 1)
        self._channel = process.channel(look)
        self._address = ctypes.addressof(self._channel)
        self._numbers = count(1)
        self._environment = 0
        self._call: str | None = None
        self._made = self._runs = False
        self._texts: list[bytes | None] = []
        self._request("load", binary, component, where)

    def __getattr__(self, method: str) -> Callable[..., Any]:
        if method.startswith("_"):
            raise AttributeError(method)
        return partial(self._request, method)

    @property
    def component(self) -> int | None:
        """The instance, for proxies; None: there is none."""
        return self._address if self._made and self.death is None else None

    def make_instance(self, environment: int, **given: Any) -> None:
        """Instantiate, as `Fmi3Slave.make_instance`; log lines go to the sink of `environment`."""
        self._environment = environment
        self._request("make_instance", **given)
        self._made = True

    def address(self, name: str) -> int:
        """Return the address of a proxy of a function.

        Raises
        ------
        ComponentError : the library has no such function.
        """
        number = self._library.function_number(name.encode())
        self._request("provide", name, number)
        if number:
            return int(self._library.proxy_of(number))
        return self._text_proxy(name)

    def exitInitializationMode(self) -> None:
        """Leave initialization mode: the limit of calls holds from now on."""
        self._request("exitInitializationMode")
        self._runs = True

    def terminate(self) -> None:
        """Terminate; the limit of calls holds no longer."""
        self._runs = False
        self._request("terminate")

    def freeInstance(self) -> None:
        """Free the instance, unload its library and let the process leave."""
        try:
            self._request("freeInstance")
        finally:
            self.abandon()

    def freeLibrary(self) -> None:
        """Unload the library and let the process leave."""
        try:
            if self.death is None:
                self._request("freeLibrary")
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Let the process leave; nothing may be called afterwards."""
        self._made, self._channel.given_up = False, 1
        self._process.close()

    def _request(self, method: str, *arguments: Any, relayed: bool = True, **options: Any) -> Any:
        """Have a method called in the other process; return its result, or raise its exception.

        `relayed` : whether the watcher of calls of this process hears of the calls.
        """
        if self.death is not None:
            raise self.death.error(method)
        number, frames = next(self._numbers), self._process.worker.frames
        try:
            frames.send(Asked.of(number, method, arguments, options), wait=False)
            self._library.announce_message(self._address)
            answer = self._answer_to(number, relayed=relayed)
        except (EOFError, OSError):
            answer = None
            self._note_silence()
        except FrameError:
            answer = None
            self._give_up("refused", _STRANGE)
        except BaseException as error:
            self._give_up("interrupted", "interrupted", error)
            raise
        if answer is None or self.death is not None:
            assert self.death is not None  # noqa: S101 - without an answer it is dead
            raise self.death.error()
        if isinstance(answer, MethodReturned):
            return self._checked(method, answer.result)
        raised = answer.exception()
        if isinstance(raised, ComponentError):
            raised.component = self.instanceName
        raise raised

    def _checked(self, method: str, result: Any) -> Any:
        """Return a result as what the method returns."""
        if method not in _RESULTS:
            return None
        try:
            return msgspec.convert(result, _RESULTS[method])
        except msgspec.ValidationError:
            self._give_up("refused", _STRANGE)
            assert self.death is not None  # noqa: S101 - just given up
            raise self.death.error() from None

    def _answer_to(self, number: int, *, relayed: bool) -> Answer | None:
        """Return the answer to a request; None if the process is ended or gone."""
        began, frames = time.monotonic(), self._process.worker.frames
        stop: BaseException | None = None
        while True:
            frames.flush()
            message = frames.receive(TICK_S)
            match message:
                case Line():
                    self._log(message.status, message.category, message.message)
                case CallBegun() | CallEnded():
                    self._call = message.call if isinstance(message, CallBegun) else None
                    if relayed:
                        stop = stop or self._relayed(begins=self._call is not None)
                case MethodReturned() | Refused() | Null() | Raised() if message.number == number:
                    if stop is not None:  # the call was under way already
                        raise stop
                    return message
                case None:
                    if (status := self._process.worker.exit_status()) is not None:
                        self._note_end(status)
                        return None
            if self._exceeds(time.monotonic() - began):
                return None

    def _relayed(self, *, begins: bool) -> BaseException | None:
        """Tell the watcher of calls of this process; return the exception by which it stops."""
        context = calling(self.instanceName, self._call or "")
        try:
            if begins:
                context.__enter__()
            else:
                context.__exit__()
        except BaseException as error:  # noqa: BLE001 - raised when the call has returned
            return error
        return None

    def look(self, waited_ns: int) -> int:
        """Take log lines, and return whether to give up a call of the loop that lasts so long."""
        try:
            self._take_lines()
            status = self._process.worker.exit_status() if waited_ns else None
        except (EOFError, OSError):
            self._note_silence()
            return 1
        except FrameError:
            self._give_up("refused", _STRANGE)
            return 1
        if status is not None:
            self._note_end(status)
        return int(status is not None or self._exceeds(waited_ns / 1e9))

    def _take_lines(self) -> None:
        frames = self._process.worker.frames
        while (message := frames.take()) is not None:
            if isinstance(message, Line):
                self._log(message.status, message.category, message.message)

    def _log(self, status: int, category: str, message: str) -> None:
        sink = sink_of(self._environment)
        if sink is not None:
            sink(status, category, message)

    def _exceeds(self, seconds: float) -> bool:
        """Whether a call takes longer than its limit; the process is ended then."""
        limit = self._process.call_limit
        if not self._runs or limit is None or seconds <= limit:
            return False
        self._give_up("timed-out", f"no answer within {limit:g} s")
        return True

    def _note_end(self, status: int) -> None:
        """Note that the process has ended by itself, and take what it logged before."""
        if self.death is None:
            death = death_of(status)
            self._give_up(death.kind, f"the process of the component {death.words}")

    def _note_silence(self) -> None:
        """Note that the process has ended, or has closed its connection and is ended for it."""
        status = self._process.worker.ended_within(_PATIENCE_S)
        if status is not None:
            self._note_end(status)
        elif self.death is None:
            self._give_up("refused", _MUTE)

    def _give_up(self, kind: str, words: str, interruption: BaseException | None = None) -> None:
        call = self._call or self._library.function_name(self._channel.function).decode() or None
        self.death = Death(self, kind, words, call, interruption)
        self._channel.given_up = 1
        self._process.worker.kill()
        with contextlib.suppress(EOFError, OSError, FrameError):
            self._take_lines()

    def _callback(self, form: str, function: Callable[..., int], given_up: int) -> int:
        """Return the address of a function in Python that C calls.

        An exception in it, such as Ctrl-C, which comes before its first line, gives the slave up,
        and is raised when the loop has returned; C gets `given_up`.
        """
        this = weakref.ref(self)

        def note(_kind: object, error: BaseException, _trace: object) -> None:
            slave = this()
            if slave is not None:
                slave.give_up_for(error)

        made: Any = _FFI.callback(form, function, error=given_up, onerror=note)
        self._kept.append(made)
        address: Any = _FFI.cast("uintptr_t", made)
        return int(address)

    def give_up_for(self, error: BaseException) -> None:
        """Give the slave up for an exception while it was waited for."""
        if self.death is None:
            self._give_up("interrupted", "interrupted", error)

    def _text_proxy(self, name: str) -> int:
        """Make the proxy of fmiNGetString or fmiNSetString and return its address."""
        this = weakref.ref(self)

        def exchange(_: object, references: int, number: int, values: int, *size: int) -> int:
            slave = this()
            if slave is None:
                return GONE
            wanted = list((c_uint32 * number).from_address(references))
            texts = (c_char_p * (size[0] if size else number)).from_address(values)
            return slave.exchange_texts(name, wanted, texts, *size)

        return self._callback(_TEXT_FUNCTIONS[name[:4]], exchange, GONE)

    def exchange_texts(self, name: str, references: list[int], texts: Any, *size: int) -> int:
        """Get or set Strings and return the status."""
        try:
            if "Get" in name:
                self._texts = self._request("getString", references, *size, relayed=False)
                texts[:] = self._texts
            else:
                given = [(text or b"").decode("utf-8") for text in texts]
                self._request("setString", references, given, relayed=False)
        except FMICallException as error:
            return int(error.status)
        except ComponentError as error:
            self.false_text = error
            return GONE
        return 0


def _looked(this: weakref.ref[IsolatedSlave], waited_ns: int) -> int:
    slave = this()
    return 1 if slave is None else slave.look(waited_ns)
