"""Event mode of an FMI 3 slave: its events, its Clocks, and the values of clocked variables.

An instant at which something happens is a sequence of super-dense instants (t, 0), (t, 1), ...:
in event mode Clocks tick, inputs are set and outputs are read; `update_discrete_states` ends one
super-dense instant and begins the next, until no slave needs another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from cosim.fmu.port import Port
from cosim.fmu.returned import LEAST_INTERVAL
from cosim.fmu.state import FmuState, StateAccess

_INTERVAL_CHANGED = 2
"""The interval of a Clock is another one since it was asked for (fmi3IntervalQualifier); 0 and 1:
not known yet, the same."""


class DiscreteStates(NamedTuple):
    """What fmi3UpdateDiscreteStates returned.

    Attributes
    ----------
    need_update : another super-dense instant is needed.
    terminate : the slave asks for the end of the run.
    next_event : the instant of its next time event [s]; None: there is none.
    """

    need_update: bool
    terminate: bool
    next_event: Fraction | None


class EventAccess(StateAccess):
    """An instance that may be in event mode.

    Attributes
    ----------
    in_event_mode : whether it is; else it is in step mode.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.in_event_mode = False

    def enter_event_mode(self) -> None:
        """Enter event mode, from step mode.

        Raises
        ------
        ComponentError : the slave refuses.
        """
        self._do("entering event mode", "enterEventMode")
        self.in_event_mode = True

    def enter_step_mode(self) -> None:
        """Return to step mode; a ComponentError if the slave refuses."""
        self._do("entering step mode", "enterStepMode")
        self.in_event_mode = False

    def update_discrete_states(self, now: Fraction) -> DiscreteStates:
        """End the super-dense instant at `now` [s].

        Raises
        ------
        ComponentError : the slave refuses, or its next event is at no instant to come.
        """
        found = self._do("updating discrete states", "updateDiscreteStates")
        need, terminate, _, _, defined, time = found
        following = None
        if defined:
            following = self._returned("fmi3UpdateDiscreteStates").next_event(time, now)
        return DiscreteStates(bool(need), bool(terminate), following)

    def advance(self, time: float) -> None:
        """Let time go on to `time` [s], of an FMU for scheduled execution."""
        self._do("letting time go on", "advance", time)

    def tick(self, clocks: Sequence[Port]) -> None:
        """Let input Clocks tick, in event mode; a ComponentError if the slave refuses."""
        references = [clock.reference for clock in clocks]
        self._do(f"the tick of {_listed(clocks)}", "setClock", references, [True] * len(clocks))

    def ticking(self, clocks: Sequence[Port]) -> list[bool]:
        """Return which output or local Clocks tick at this super-dense instant, in event mode."""
        references = [clock.reference for clock in clocks]
        found = self._do(f"reading {_listed(clocks)}", "getClock", references)
        return [bool(one) for one in found]

    def interval(self, clock: Port, *, always: bool = False) -> Fraction | None:
        """Return the interval of a Clock [s] if it is another one since it was asked for.

        `always` : also if it is the same.

        Raises
        ------
        ComponentError : the slave refuses, or gives what is no interval.
        """
        what, fractions = f"reading the interval of {clock.name}", _fractions(clock)
        raw, number = self._do(what, "intervals", [clock.reference], fractions)[0]
        judge = self._returned(f"fmi3GetInterval{'Fraction' if fractions else 'Decimal'}")
        if judge.qualifier(clock.name, number) != _INTERVAL_CHANGED and not always:
            return None
        periodic = clock.clock is not None and clock.clock.periodic
        least = LEAST_INTERVAL if periodic else Fraction(0)
        return judge.interval(clock.name, raw, least=least)

    def shift(self, clock: Port) -> Fraction:
        """Return the shift of a Clock [s]; a ComponentError if it is none."""
        what, fractions = f"reading the shift of {clock.name}", _fractions(clock)
        raw = self._do(what, "shifts", [clock.reference], fractions)[0]
        judge = self._returned(f"fmi3GetShift{'Fraction' if fractions else 'Decimal'}")
        return judge.interval(clock.name, raw, what="a shift")

    def set_interval(self, clock: Port, interval: Fraction) -> None:
        """Give a Clock its interval [s]; a ComponentError if the slave refuses."""
        what = f"setting the interval of {clock.name}"
        self._do(what, "set_interval", clock.reference, interval, _fractions(clock))

    def restore(self, state: FmuState) -> None:
        """Return to a saved state, which stays saved."""
        super().restore(state)
        self.in_event_mode = state.event_mode

    def _kept(self, pointer: Any) -> FmuState:
        state = super()._kept(pointer)
        state.event_mode = self.in_event_mode
        return state


def _listed(clocks: Sequence[Port]) -> str:
    return ", ".join(clock.name for clock in clocks)


def _fractions(clock: Port) -> bool:
    return clock.clock is not None and clock.clock.supports_fraction
