"""A component in event mode during a run: its events, the ticks of its Clocks, its values.

Instants are rational numbers of seconds; at the points they are rounded to whole nanoseconds, and
what falls on the same nanosecond happens at the same instant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError
from cosim.fmu import LEAST_INTERVAL, FmuSlave, Port, exactly
from cosim.master.component_instance import ComponentInstance, Group, Rows
from cosim.master.exchange import OK, exchange_of

SECOND_NS = 10**9


def nanosecond_of(instant: Fraction) -> int:
    """Return the whole nanosecond that is nearest to an instant [s]."""
    return round(instant * SECOND_NS)


class EventInstance:
    """A component instance in event mode.

    Attributes
    ----------
    slave : its slave.
    next_event : instant of its next time event [s]; None: there is none.
    event_needed : its last step ended with an event.
    time : where its slave is [s], as it was told.
    word : of the loop, as `Table.word`: calls that are made within an operation and are another one
        than the operation's are told as calls outside the loop.
    """

    def __init__(self, number: int, instance: ComponentInstance) -> None:
        self.number, self.instance = number, instance
        self.slave: FmuSlave = instance.slave
        ports = instance.component.description.ports
        self._ports = ports
        self._time_based = [p for p in ports.values() if p.ticks_by_time]
        self._next: dict[str, Fraction] = {}
        self._intervals: dict[str, Fraction] = {}
        self._given: dict[str, list[Fraction]] = {}
        self._ticking: dict[str, bool] = {}
        self._needs_update = False
        self.next_event: Fraction | None = None
        self.event_needed = False
        self.time = 0.0
        self.word = np.zeros(2, np.int64)

    def prepare(self, start: Fraction) -> None:
        """Read and set the intervals of its Clocks, in the initialisation, from `start` [s].

        Raises
        ------
        ComponentError : the slave refuses, or gives an interval that is none.
        """
        self._next.clear()
        self._intervals.clear()
        self.next_event, self.event_needed, self.time = None, False, float(start)
        asked = self.instance.component.clocks
        for name, ticks in asked.items():
            if isinstance(ticks, Sequence):
                instants = [exactly(float(one)) for one in ticks]
                self._given[name] = [one for one in instants if one >= start]
        for port in self._time_based:
            clock, name = port.clock, port.name
            if clock is None:
                continue
            given = asked.get(name)
            if clock.periodic:
                interval, shift = clock.interval, clock.shift
                if given is not None and not isinstance(given, Sequence):
                    interval = given if isinstance(given, Fraction) else exactly(float(given))
                    self.slave.set_interval(port, interval)
                elif interval is None:
                    interval = self.slave.interval(port, always=True)
                    shift = self.slave.shift(port)
                self._intervals[name] = self._checked(port, interval)
                self._next[name] = start + shift
            else:
                self._ask(port, start, first=True)

    def due(self, now_ns: int) -> list[Port]:
        """Return the Clocks that the master lets tick at an instant [ns]; they are due no more."""
        found = []
        for name, instant in list(self._next.items()):
            if nanosecond_of(instant) > now_ns:
                continue
            found.append(self._ports[name])
            del self._next[name]
            if name in self._intervals:
                self._next[name] = instant + self._intervals[name]
        for name, instants in self._given.items():
            while instants and nanosecond_of(instants[0]) <= now_ns:
                instants.pop(0)
                found.append(self._ports[name])
        return sorted(found, key=_by_priority)

    def has_event(self, now_ns: int) -> bool:
        """Whether its last step ended with an event, or a time event has come."""
        timed = self.next_event is not None and nanosecond_of(self.next_event) <= now_ns
        return self.event_needed or timed

    def is_busy(self, now_ns: int) -> bool:
        """Whether it asks for an event now, or within a nanosecond."""
        soon = any(nanosecond_of(instant) <= now_ns + 1 for instant in self.instants())
        return self.event_needed or self._needs_update or soon

    def instants(self) -> Iterable[Fraction]:
        """Return its next time event and ticks [s]."""
        timed = () if self.next_event is None else (self.next_event,)
        return [*timed, *self._next.values(), *(one[0] for one in self._given.values() if one)]

    def enter_event_mode(self) -> None:
        """Enter event mode, unless it is there."""
        if not self.slave.in_event_mode:
            with self._outside_the_loop():
                self.slave.enter_event_mode()
        self.event_needed = False

    def tick(self, clocks: Sequence[Port]) -> None:
        """Let input Clocks tick at this super-dense instant."""
        new = [clock for clock in clocks if not self._ticking.get(clock.name)]
        if new:
            self.enter_event_mode()
            with self._outside_the_loop():
                self.slave.tick(new)
            self._ticking.update((clock.name, True) for clock in new)

    def update(self, now: Fraction) -> tuple[bool, bool]:
        """End its super-dense instant at `now` [s].

        Returns
        -------
        need_update, terminate : as in `DiscreteStates`.
        """
        found = self.slave.update_discrete_states(now)
        self._needs_update = found.need_update
        self.next_event = None
        if found.next_event is not None:  # never at this instant again, though its clock may lag
            least = Fraction(nanosecond_of(now) + 1, SECOND_NS)
            self.next_event = max(found.next_event, least)
        for port in self._time_based:
            clock, ticked = port.clock, self._ticking.get(port.name, False)
            if clock is None:
                continue
            if clock.variability == "countdown" or (clock.variability == "changing" and ticked):
                self._ask(port, now)
            elif clock.variability == "tunable" and clock.interval is None:
                interval = self.slave.interval(port)
                if interval is not None:
                    self._intervals[port.name] = interval
                    self._next[port.name] = now + interval
        self._ticking.clear()
        return found.need_update, found.terminate

    def _ask(self, port: Port, now: Fraction, *, first: bool = False) -> None:
        """Ask for the next interval of an aperiodic Clock, which begins now."""
        changing = port.clock is not None and port.clock.variability == "changing"
        interval = self.slave.interval(port, always=changing and not first)
        if interval is not None:
            self._next[port.name] = now + interval

    def _checked(self, port: Port, interval: Fraction | None) -> Fraction:
        """Return the interval of a periodic Clock, as declared, given by the scenario or read."""
        if interval is None or interval < LEAST_INTERVAL:
            raise ComponentError(
                f"the interval of {port.name} is none",
                where=f"component {self.instance.name!r}",
                expected=f"at least {float(LEAST_INTERVAL):g} s",
                got="none" if interval is None else f"{float(interval):g} s",
            )
        return interval

    def is_active(self, names: Iterable[str]) -> bool:
        """Whether one of these Clocks ticks at this super-dense instant."""
        if not self.slave.in_event_mode:
            return False
        for name in names:
            port = self._ports[name]
            if not self._ticking.get(name) and port.causality != "input":
                with self._outside_the_loop():
                    self._ticking[name] = self.slave.ticking([port])[0]
            if self._ticking.get(name):
                return True
        return False

    @contextmanager
    def _outside_the_loop(self) -> Iterator[None]:
        """Context of a call that is not that of the operation in progress, if one is."""
        before, self.word[1] = self.word[1], 0
        try:
            yield
        finally:
            self.word[1] = before

    def column_of(self, name: str) -> int:
        """Return the column of an input Clock in the rows."""
        return self.instance.place(name)[0]

    def exchange(self, group: Group, way: Literal["get", "set"]) -> Callable[[Rows, int], int]:
        """Return what gets or sets a group in a row of the rows, in event mode and out of it."""
        ports = self._ports_of(group)
        columns = slice(group.column, group.column + group.size)
        if group.getter_type == "Clock":
            return self._clock_exchange(ports, columns, way)
        plain = exchange_of(self.instance, group, way)
        if way == "get":
            return self._getting(group, columns, plain)
        return self._setting(group, columns, plain)

    def _ports_of(self, group: Group) -> list[Port]:
        kinds = {
            (port.getter_type, port.reference): port
            for port in reversed([c.port for c in self._columns()])
        }
        return [kinds[group.getter_type, reference] for reference in group.references.tolist()]

    def _columns(self) -> Sequence[Any]:
        return (*self.instance.output_columns, *self.instance.input_columns)

    def jumps_of(self, group: Group) -> NDArray[np.bool_]:
        """Return of each value of a group of inputs whether its jump is an event, (values,)."""
        ports = self._ports_of(group)
        if group.getter_type == "Clock":
            return np.ones(group.size, np.bool_)  # a tick is
        discrete = [not group.clocks and port.variability != "continuous" for port in ports]
        return np.repeat(discrete, [port.size for port in ports])

    def _clock_exchange(
        self, ports: Sequence[Port], columns: slice, way: Literal["get", "set"]
    ) -> Callable[[Rows, int], int]:
        def get(rows: Rows, at: int) -> int:
            found = [False] * len(ports)
            if self.slave.in_event_mode:
                found = self.slave.ticking(ports)
                self._ticking.update(zip((p.name for p in ports), found, strict=True))
            rows[at, columns] = found
            return OK

        def give(rows: Rows, at: int) -> int:
            given = zip(ports, rows[at, columns].tolist(), strict=True)
            self.tick([port for port, ticks in given if ticks])
            return OK

        return get if way == "get" else give

    def _getting(
        self, group: Group, columns: slice, plain: Callable[[Rows], int]
    ) -> Callable[[Rows, int], int]:
        first = [self._start_of(port) for port in self._ports_of(group) for _ in range(port.size)]

        def get(rows: Rows, at: int) -> int:
            if group.clocks and not self.is_active(group.clocks):  # it has no value of its own now
                rows[at, columns] = rows[at - 1, columns] if at > 0 else first
                return OK
            return plain(rows[at])

        return get

    def _start_of(self, port: Port) -> float:
        """Return what a clocked output has in the rows before its Clock ticks: its start, or 0."""
        if port.kind not in ("float", "int", "bool") or port.start is None or port.shape:
            return 0.0
        return float(port.start)

    def _setting(
        self, group: Group, columns: slice, plain: Callable[[Rows], int]
    ) -> Callable[[Rows, int], int]:
        discrete = self.jumps_of(group)
        points = self.instance.comm_points.points_ns

        def give(rows: Rows, at: int) -> int:
            if group.clocks and not self.is_active(group.clocks):
                return OK
            if at > 0 and not self.slave.in_event_mode:
                # a jump is an event: of a discrete input always, of another one within an instant
                changed = rows[at, columns] != rows[at - 1, columns]
                if (changed if points[at] == points[at - 1] else changed & discrete).any():
                    self.enter_event_mode()
            return plain(rows[at])

        return give


def _by_priority(port: Port) -> tuple[int, int]:
    """Sort Clocks that tick at one instant by priority, then as declared."""
    priority = None if port.clock is None else port.clock.priority
    return (2**32 if priority is None else priority, port.reference)
