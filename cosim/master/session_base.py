"""What sessions have in common, whether their slaves are in this process or in a child."""

from __future__ import annotations

import functools
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Concatenate, Literal, NamedTuple, ParamSpec, TypeVar

import numpy as np

from cosim.core import ComponentError, InputError, is_inside
from cosim.master.component_instance import ComponentInstance
from cosim.master.run import RunStatus
from cosim.master.system import System
from cosim.trace.outcome import Cause

_PARTS = ("kind", "component", "call", "detail")
"""What an error has of the cause of a run."""
S = TypeVar("S", bound="SessionBase")
P = ParamSpec("P")
T = TypeVar("T")


def one_thread_at_a_time(
    method: Callable[Concatenate[S, P], T],
) -> Callable[Concatenate[S, P], T]:
    """Decorate a method of a session: it is refused while another thread is in such a call."""

    @functools.wraps(method)
    def guarded(self: S, /, *args: P.args, **kwargs: P.kwargs) -> T:
        if not self.in_use.acquire(blocking=False):
            raise InputError(
                "another thread is in a call of this session",
                where="Session",
                expected="one call at a time, from whichever thread",
                hint="a session for each thread",
            )
        try:
            return method(self, *args, **kwargs)
        finally:
            self.in_use.release()

    return guarded


class NamedSignals(NamedTuple):
    """Signals of a component that a name stands for.

    Attributes
    ----------
    members : variables, or elements of arrays.
    single : whether the name is that of one, not of a group.
    exchanged : the outputs and connected inputs of the component.
    """

    component: str
    members: list[str]
    single: bool
    exchanged: frozenset[str]


class SessionBase(ABC):
    """How a session stands: its times, its status, and what it refuses.

    Attributes
    ----------
    system : the system that runs.
    in_use : held by the thread that is in a call: another one is refused, and closing waits.
    """

    _how_to_open: ClassVar = "with Session(...)"

    def __init__(self, system: System) -> None:
        self.system = system
        self.in_use = threading.RLock()
        self._closed = False
        self._named: dict[str, NamedSignals] = {}

    @property
    @abstractmethod
    def opened(self) -> bool:
        """Whether its slaves are initialised."""

    @property
    @abstractmethod
    def time_ns(self) -> int:
        """The time of the run [ns]; it begins at 0, also where the slaves' time does not."""

    @property
    @abstractmethod
    def row_time_ns(self) -> int:
        """The time of the run at the last complete row [ns]."""

    @property
    @abstractmethod
    def status(self) -> RunStatus | Literal["running"] | None:
        """How the run stands: "running", or as `Run.status`; None before it is loaded."""

    @property
    @abstractmethod
    def reason(self) -> str | None:
        """As `Run.reason`; None while it runs."""

    @property
    @abstractmethod
    def cause(self) -> Cause | None:
        """As `Run.cause`; None while it runs."""

    @property
    @abstractmethod
    def end_failure(self) -> ComponentError | None:
        """What ended the process of a component as it was terminated or freed."""

    @property
    @abstractmethod
    def instances(self) -> Sequence[ComponentInstance]:
        """The components of the run."""

    @abstractmethod
    def read(self, component: str, variable: str) -> Any:
        """Return the present value of any variable, read from the slave."""

    @abstractmethod
    def value(self, component: str, variable: str) -> Any:
        """Return the value of an output or connected input."""

    @abstractmethod
    def set(self, component: str, variable: str, value: Any) -> None:
        """Set a tunable parameter, or an input that is not connected."""

    @abstractmethod
    def override(self, component: str, variable: str, value: float) -> None:
        """Replace an output or connected input by `value`, until it is released."""

    def __getitem__(self, name: str) -> Any:
        """Return the present value of a variable, `plant.x[1]`, or of a group, `plant.x`.

        Of a group, and of an array, an array of doubles, (signals,).

        Raises
        ------
        InputError : no such component or variable.
        """
        signals = self.named(name)
        values = [
            self.value(signals.component, one)
            if one in signals.exchanged
            else self.read(signals.component, one)
            for one in signals.members
        ]
        return values[0] if signals.single else np.array(values, np.float64)

    def __setitem__(self, name: str, value: Any) -> None:
        """Set an input or a tunable parameter, or each of a group from a sequence.

        An output or a connected input is replaced from now on, as by `override`.

        Raises
        ------
        InputError : as of `set` and `override`; a sequence of another length.
        """
        signals = self.named(name)
        values = [value] if signals.single else list(value)
        if len(values) != len(signals.members):
            raise InputError(
                "values and signals do not match",
                where=name,
                expected=f"{len(signals.members)} values: {', '.join(signals.members[:8])}",
                got=str(len(values)),
            )
        for one, each in zip(signals.members, values, strict=True):
            if one in signals.exchanged:
                self.override(signals.component, one, float(each))
            else:
                self.set(signals.component, one, each)

    def named(self, name: str) -> NamedSignals:
        """Return the signals that a name stands for.

        Raises
        ------
        InputError : no such component or variable.
        """
        self.check_open()
        if name not in self._named:
            self._named[name] = self._signals_of(name)
        return self._named[name]

    def _signals_of(self, name: str) -> NamedSignals:
        component, _, variable = name.partition(".")
        if component not in self.system.components:
            raise InputError.unknown("component", component, self.system.components, where=name)
        columns = next(one for one in self.instances if one.name == component).column_names
        ports = self.system.components[component].description.ports
        if not variable:
            raise InputError(
                "a component, not a variable",
                where=name,
                expected=f"as in {name}.{next(iter(columns or ports), 'x')}",
            )
        known = dict.fromkeys([*columns, *ports])
        members = [one for one in known if is_inside(one, variable)]
        scalar = variable in columns or (variable in ports and not ports[variable].dimensions)
        if scalar or (variable in ports and not members):
            members = [variable]
        if not members:
            raise InputError.unknown("variable", variable, known, where=f"component {component!r}")
        return NamedSignals(component, members, members == [variable], frozenset(columns))

    @property
    def time_s(self) -> float:
        """The time of the slaves [s]."""
        return self.system.comm_schedule.at_s(self.time_ns)

    @property
    def row_time_s(self) -> float:
        """The time of the slaves at the last complete row [s]."""
        return self.system.comm_schedule.at_s(self.row_time_ns)

    @property
    def ended(self) -> bool:
        """Whether the run is at its end or cannot continue."""
        return self.status not in (None, "running")

    def instant_ns(self, seconds: float | None) -> int | None:
        """Return the instant of the run [ns] at a time of the slaves [s]."""
        start_ns = self.system.comm_schedule.start_ns
        return None if seconds is None else round(seconds * 1e9) - start_ns

    def check_open(self) -> None:
        """Raise what calls raise before and after the `with` block."""
        if self._closed:
            raise InputError(
                "the session is closed",
                where="Session",
                hint="take values and result() inside its with block",
            )
        if not self.opened:
            raise InputError("the session is not open", where="Session", hint=self._how_to_open)

    def check_not_failed(self) -> None:
        """Raise what every call raises once the session has failed."""
        self.check_open()
        if self.status == "failed":
            raise self._failure()

    def _failure(self) -> ComponentError:
        """Return the error of the run's failure, with the parts of its cause."""
        return error_of(self.cause, self.reason or "the run has failed")


def error_of(cause: Cause | None, words: str) -> ComponentError:
    """Return a failure as an error with the parts of its cause."""
    parts = {} if cause is None else {key: getattr(cause, key) for key in _PARTS}
    return ComponentError(words, **parts)
