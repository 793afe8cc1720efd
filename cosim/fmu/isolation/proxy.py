"""An isolated slave as the process of the master sees it: with the methods of FMPy's slaves."""

from __future__ import annotations

import ctypes
import time
import weakref
from collections.abc import Callable
from ctypes import c_char_p, c_uint32
from functools import partial
from itertools import count
from types import MappingProxyType
from typing import Any, Final

from _cffi_backend import FFI  # reads C types itself: no parser of C has to be loaded
from fmpy.fmi1 import FMICallException

from cosim.core import DEATH_HINTS, ComponentError, death_of
from cosim.fmu.binary import Binary
from cosim.fmu.call_watch import calling
from cosim.fmu.isolation.channel import GONE, channel_library
from cosim.fmu.isolation.messages import BEGIN, END, LINE, RETURNED, packed, unpacked
from cosim.fmu.isolation.process import TICK_S, SlaveProcess
from cosim.fmu.messages import sink_of

_LIMIT_HINT: Final = (
    "a greater limit: --limit call=..., or limits.call in the scenario; none for no limit"
)
_PATIENCE_S: Final = 1.0
_FFI: Final = FFI()
_LOOK: Final = "int(int64_t)"
_TEXT_FUNCTIONS: Final = MappingProxyType(
    {
        "fmi2": "int(void *, uintptr_t, size_t, uintptr_t)",
        "fmi3": "int(void *, uintptr_t, size_t, uintptr_t, size_t)",
    }
)


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
    """

    def __init__(self, process: SlaveProcess, binary: Binary, component: str, where: str) -> None:
        self.where, self.instanceName = where, component
        self.death: Death | None = None
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
        number = next(self._numbers)
        try:
            self._library.announce_message(self._address)  # first: a long message must be read
            self._process.connection.send_bytes(packed(number, method, arguments, options))
            kind, content = self._answer_to(number, relayed=relayed)
        except (EOFError, OSError):
            self._note_end(self._process.wait(_PATIENCE_S))
        except BaseException as error:
            self._give_up("interrupted", "interrupted", error)
            raise
        if self.death is not None:
            raise self.death.error()
        if kind == RETURNED:
            return content
        raise content

    def _answer_to(self, number: int, *, relayed: bool) -> tuple[str, Any]:
        began, connection = time.monotonic(), self._process.connection
        stop: BaseException | None = None
        while True:
            if connection.poll(TICK_S):
                kind, *content = unpacked(connection.recv_bytes())
                if kind == LINE:
                    self._log(*content)
                elif kind in (BEGIN, END):
                    self._call = content[0] if kind == BEGIN else None
                    if relayed:
                        stop = stop or self._relayed(kind)
                elif content[0] == number:
                    if stop is not None:  # the call was under way already
                        raise stop
                    return kind, content[1]
            elif (status := self._process.exit_status()) is not None:
                self._note_end(status)
                return "", None
            elif self._exceeds(time.monotonic() - began):
                return "", None

    def _relayed(self, kind: str) -> BaseException | None:
        """Tell the watcher of calls of this process; return the exception by which it stops."""
        context = calling(self.instanceName, self._call or "")
        try:
            if kind == BEGIN:
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
            status = self._process.exit_status() if waited_ns else None
        except (EOFError, OSError):
            status = self._process.wait(_PATIENCE_S)
        if status is not None:
            self._note_end(status)
        return int(status is not None or self._exceeds(waited_ns / 1e9))

    def _take_lines(self) -> None:
        connection = self._process.connection
        while connection.poll():
            kind, *content = unpacked(connection.recv_bytes())
            if kind == LINE:
                self._log(*content)

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

    def _give_up(self, kind: str, words: str, interruption: BaseException | None = None) -> None:
        call = self._call or self._library.function_name(self._channel.function).decode() or None
        self.death = Death(self, kind, words, call, interruption)
        self._channel.given_up = 1
        self._process.kill()
        try:
            self._take_lines()
        except (EOFError, OSError):
            return

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
        except ComponentError:
            return GONE
        return 0


def _looked(this: weakref.ref[IsolatedSlave], waited_ns: int) -> int:
    slave = this()
    return 1 if slave is None else slave.look(waited_ns)
