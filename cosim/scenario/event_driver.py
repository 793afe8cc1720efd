"""Run a session from one event to the next and execute the events."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master import (
    NOT_WATCHED,
    ComponentInstance,
    Connection,
    Guards,
    Pace,
    Run,
    Session,
    System,
)
from cosim.scenario.binding import BoundExpression
from cosim.scenario.link_keys import nanoseconds
from cosim.scenario.scope import RunScope, ValueReader
from cosim.scenario.script import Action, Event, Machine
from cosim.trace.outcome import Cause

LINK_SETTINGS = ("delay", "loss")
"""What conditions change of a link: its traffic, not what components say."""


class Due(NamedTuple):
    """Begin or end of an event at an instant; ends come first, then the scenario's order."""

    time_ns: int
    begins: bool
    number: int
    turn: int


class LatestValues:
    """The values of the last complete row, and the conditions of events on complete rows."""

    def __init__(self, scope: RunScope, instances: Sequence[ComponentInstance]) -> None:
        self._scope, self._instances = scope, instances

    @cached_property
    def _places(self) -> dict[str, tuple[ComponentInstance, int]]:
        """By name of an output or connected input: its instance and column of the rows."""
        return {
            f"{instance.name}.{column.name}": (instance, first + j)
            for instance in self._instances
            for first, columns in (
                (instance.output_column, instance.output_columns),
                (instance.input_column, instance.input_columns),
            )
            for j, column in enumerate(columns)
        }

    def value(self, name: str, session: Session) -> float:
        """Return the value of an output or connected input in the last complete row."""
        session.make_rows_whole()
        instance, column = self._places[name]
        return float(instance.rows[instance.own_points.last[session.rows - 1], column])

    def guards(self, conditions: Sequence[BoundExpression]) -> Guards:
        """Return the conditions as guards; none of them is watched yet."""
        others = {
            name: partial(_values_at, ValueReader(self._instances, self._scope, [name]))
            for condition in conditions
            for name in condition.names
            if name not in self._places
        }
        return Guards(conditions, self._places, others)

    def inputs_of(self, connection: Connection) -> list[str]:
        """Return the names of the elements of a connection's target."""
        name, variable = connection.target
        instance = next(one for one in self._instances if one.name == name)
        return [c.name for c in instance.input_columns if c.port.name == variable]


def _values_at(reader: ValueReader, first: int, last: int) -> NDArray[np.float64]:
    return reader.read(first, last)[0]


class EventDriver:
    """Executes the events of a run, and its mode machines.

    Attributes
    ----------
    stopped : why an event ended the run; None if none did.
    altered : what events changed but the traffic of links, each once, `component.variable`.
    event_counts : how often each event happened, and each machine changed its state.
    """

    def __init__(
        self, system: System, script: Sequence[Event | Machine], rows: LatestValues
    ) -> None:
        self._system, self._script, self._rows = system, script, rows
        events = self._events = [one for one in script if isinstance(one, Event)]
        self._machines = [one for one in script if isinstance(one, Machine)]
        inside = (event for one in self._machines for state in one.events for event in state)
        self._by_number = {e.number: e for e in (*events, *inside) if e is not None}
        self._active: set[int] = set()  # events that a condition ends
        self._modes: dict[str, tuple[int, int]] = {}  # number of the state, since when [ns]
        self._next = {machine.name: machine.initial for machine in self._machines}
        self._due: list[Due] = []
        self._turn = 0
        self._before = dict.fromkeys((e.number for e in events), False)
        self._saved: dict[tuple[int, Action], Any] = {}
        self.stopped: str | None = None
        self.altered: dict[str, None] = {}
        self.event_counts = [0] * len(script)
        for event in events:
            if event.at_ns is not None:
                self._plan(event.at_ns, event.number, begins=True)
        self._watched = [event.number for event in events if event.condition is not None]
        self._conditions = {k: one for k, one in self._all_conditions() if one is not None}
        self._places = {key: place for place, key in enumerate(self._conditions)}

    @cached_property
    def _guards(self) -> Guards:
        return self._rows.guards([*self._conditions.values()])

    def _all_conditions(self) -> Iterator[tuple[tuple[str, int], BoundExpression | None]]:
        """Yield the conditions of the script by whose they are, with a number."""
        for event in self._events:
            yield ("when", event.number), event.condition
            yield ("ends", event.number), event.ends
        for machine in self._machines:
            for i, each in enumerate(machine.transitions):
                yield (f"of {machine.name}", i), each.condition

    def drive(self, session: Session, pace: Pace | None = None) -> None:
        """Run to the end, or to where an event stops it."""
        self.advance(session, pace=pace)

    def advance(
        self,
        session: Session,
        until_ns: int | None = None,
        *,
        most: int | None = None,
        stop: Callable[[Session], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue as `Session.go_on`, and execute the events on the way.

        stop : is asked after every row, when the events at the time of the session have happened.
        """
        rows = math.inf if most is None else session.rows + most
        asked, stopped = session.rows, False
        while session.status == "running" and self.stopped is None and not stopped:
            self.execute_due(session)
            if stop is not None and session.rows > asked:
                asked, stopped = session.rows, stop(session)
            reached = session.rows >= rows or (until_ns is not None and session.time_ns >= until_ns)
            if self.stopped is not None or reached or stopped:
                break
            instants = [*(due.time_ns for due in self._due[:1]), until_ns]
            longest = None if most is None else int(rows) - session.rows
            if self._watch(session.time_ns, instants) or stop is not None:
                longest = 1
            guards = self._guards if self._places and stop is None else None
            session.advance(_earliest(instants), most=longest, guards=guards, pace=pace)
            if session.rows:
                self._look(session)
        if stop is not None and not stopped and session.rows > asked and session.status != "failed":
            stopped = stop(session)  # the last row
        return stopped

    def _watch(self, now_ns: int, instants: list[int | None]) -> bool:
        """Set what the guards expect, and add the instants of what waits for its time alone.

        Return whether a machine goes on at the next point, whatever the row says.
        """
        expected: dict[tuple[str, int], int] = {}
        for number in self._watched:
            event = self._events[number]
            if event.every_time or not self.event_counts[number]:
                expected["when", number] = self._before[number]
            if number in self._active:
                expected["ends", number] = False
        at_next = False
        for machine in self._machines:
            state, since_ns = self._modes[machine.name]
            for i, each in enumerate(machine.transitions):
                if state not in each.sources:
                    continue
                if since_ns + each.after_ns > now_ns:
                    instants.append(since_ns + each.after_ns)
                elif each.condition is None:
                    at_next = True
                else:
                    expected[f"of {machine.name}", i] = False
        for key, place in self._places.items():
            self._guards.expected[place] = expected.get(key, NOT_WATCHED)
        return at_next

    def execute_due(self, session: Session) -> None:
        """Execute the events, and then the transitions, that are due at the time of the session."""
        while self._due and self._due[0].time_ns <= session.time_ns and not self.stopped:
            self._happen(heapq.heappop(self._due), session)
        for number, machine in enumerate(self._machines, len(self._events)):
            if machine.name in self._next and not self.stopped:
                self._enter(machine, self._next.pop(machine.name), session)
                self.event_counts[number] += 1

    def state(self) -> dict[str, Any]:
        """Return what has happened and what is due, JSON-safe, for `restore`."""
        return {
            "events": self._words(),
            "due": [list(due) for due in sorted(self._due)],
            "turn": self._turn,
            "before": [self._before[event.number] for event in self._events],
            "saved": [
                [number, self._key_place(number, key), value]
                for (number, key), value in self._saved.items()
            ],
            "stopped": self.stopped,
            "altered": list(self.altered),
            "counts": list(self.event_counts),
            "active": sorted(self._active),
            "modes": {name: list(mode) for name, mode in self._modes.items()},
            "next": dict(self._next),
        }

    def _words(self) -> list[str]:
        """Return what the script is made of, in words."""
        machines = (f"{one.name}: {', '.join(one.states)}" for one in self._machines)
        return [*(event.words for event in self._events), *machines]

    def restore(self, state: Mapping[str, Any]) -> None:
        """Return to a state of these events.

        Raises
        ------
        InputError : a state of other events.
        """
        words = self._words()
        if state.get("events", []) != words:
            raise InputError(
                "the snapshot is of a session with other events",
                where="Session.restore",
                expected=", ".join(words) or "no events",
                got=", ".join(state.get("events", [])) or "no events",
            )
        if not words:
            return
        self._due = [Due(*due) for due in state["due"]]
        self._turn = state["turn"]
        self._before = {e.number: b for e, b in zip(self._events, state["before"], strict=True)}
        self._saved = {
            (number, _key(self._by_number[number].actions[place])): value
            for number, place, value in state["saved"]
        }
        self.stopped, self.altered = state["stopped"], dict.fromkeys(state["altered"])
        self.event_counts = list(state["counts"])
        self._active = set(state["active"])
        self._modes = {name: (mode[0], mode[1]) for name, mode in state["modes"].items()}
        self._next = dict(state["next"])

    def _key_place(self, number: int, key: Action) -> int:
        return [_key(action) for action in self._by_number[number].actions].index(key)

    def _plan(self, time_ns: int, number: int, *, begins: bool) -> None:
        self._turn += 1
        heapq.heappush(self._due, Due(time_ns, begins, number, self._turn))

    def _look(self, session: Session) -> bool:
        """Plan what the conditions on the last row begin or end; whether there is anything."""
        if self._places and self._guards.reads_inputs:
            session.make_rows_whole()
        found = False
        for number in self._watched:
            event = self._events[number]
            now = self._holds("when", number, session)
            rising = now and not self._before[number]
            self._before[number] = now
            if number in self._active:
                if self._holds("ends", number, session):
                    found = True
                    self._active.remove(number)
                    self._plan(session.time_ns, number, begins=False)
            elif rising and (event.every_time or not self.event_counts[number]):
                found = True
                self._plan(session.time_ns, number, begins=True)
        return self._look_at_modes(session) or found

    def _holds(self, whose: str, number: int, session: Session) -> bool:
        """Whether a condition holds in the last row."""
        return self._guards.holds(self._places[whose, number], session.rows - 1)

    def _look_at_modes(self, session: Session) -> bool:
        """Find the transitions that are taken at the next point; whether there are any."""
        for machine in self._machines:
            if machine.name in self._next:
                continue
            state, since_ns = self._modes[machine.name]
            for i, each in enumerate(machine.transitions):
                may = state in each.sources and session.time_ns - since_ns >= each.after_ns
                if may and (
                    each.condition is None or self._holds(f"of {machine.name}", i, session)
                ):
                    self._next[machine.name] = each.target
                    break
        return bool(self._next)

    def _enter(self, machine: Machine, target: int, session: Session) -> None:
        """Leave the state of a machine and enter another one."""
        name, before = machine.name, self._modes.get(machine.name)
        self._modes[name] = target, session.time_ns
        words = machine.states[target]
        if before is not None:
            left = machine.events[before[0]]
            words = f"{machine.states[before[0]]} -> {words}"
            if left.exit is not None:
                self._begin(left.exit, session)
            if left.during is not None:
                self._over(left.during, session)
        session.set_event_value(name, float(target))
        session.note("info", name, words)
        for event in (machine.events[target].during, machine.events[target].enter):
            if event is not None and self.stopped is None:
                self._begin(event, session)

    def _happen(self, due: Due, session: Session) -> None:
        event = self._events[due.number]
        if not due.begins:
            self._over(event, session)
            return
        self.event_counts[event.number] += 1
        if event.ends is not None:
            self._active.add(event.number)
        self._begin(event, session)

    def _over(self, event: Event, session: Session) -> None:
        """Undo what an event has done."""
        for action in event.actions:
            self._undo(event, action, session)
        session.note("info", "scenario", f"{event.words} is over")
        for link in event.outages:
            _note_outage(link, event, session, begins=False)

    def _begin(self, event: Event, session: Session) -> None:
        """Do what an event does."""
        for action in event.actions:
            self._act(event, action, session)
        actions_text = ", ".join(str(action) for action in event.actions)
        session.note(
            "info", "scenario", f"{event.words}{': ' if actions_text else ''}{actions_text}"
        )
        for link in event.outages:
            _note_outage(link, event, session, begins=True)
        if event.lasts_ns is not None:
            self._plan(session.time_ns + event.lasts_ns, event.number, begins=False)
        if event.stop is not None:
            if event.condition is None:
                session.advance(most=1)  # the point of its time is the last one
            self.stopped = f"stopped at t = {session.row_time_s:g} s by {event.words}" + (
                f": {event.stop}" if event.stop else ""
            )
            session.note("info", "scenario", self.stopped, time_ns=session.row_time_ns)

    def _act(self, event: Event, action: Action, session: Session) -> None:
        component, variable = action.target
        if action.kind not in LINK_SETTINGS:
            self.altered[str(action.target).strip(".")] = None
        match action.kind:
            case "set":
                if event.undone:
                    key = event.number, _key(action)
                    self._saved.setdefault(key, session.read(component, variable))
                session.set(component, variable, action.value)
            case "override":
                session.override(component, variable, action.value)
            case "bias":
                session.bias(component, variable, action.value, action.factor)
            case "freeze":
                value = self._rows.value(f"{component}.{variable}", session)
                session.override(component, variable, value)
            case "release":
                session.release(component, variable)
            case "reset":
                session.reset(component)
            case _:
                self._change_link(component, event, action, session)

    def _change_link(self, link: str, event: Event, action: Action, session: Session) -> None:
        match action.kind:
            case "outage":
                self._hold(link, session, hold=True)
            case "restore":
                self._hold(link, session, hold=False)
                _note_outage(link, event, session, begins=False)
                for setting in LINK_SETTINGS:
                    session.set_event_value(f"{link}.{setting}", math.nan)
            case "delay":
                session.set_event_value(f"{link}.delay", float(nanoseconds(action.value)))
            case "loss":
                session.set_event_value(f"{link}.loss", action.value)

    def _hold(self, link: str, session: Session, *, hold: bool) -> None:
        """Hold the inputs behind a link at their present values, or release them."""
        for connection in self._system.connections:
            target = connection.target.component
            for name in self._rows.inputs_of(connection) if connection.link == link else ():
                if hold:
                    session.override(target, name, self._rows.value(f"{target}.{name}", session))
                else:
                    session.release(target, name)

    def _undo(self, event: Event, action: Action, session: Session) -> None:
        component, variable = action.target
        match action.kind:
            case "set":
                session.set(component, variable, self._saved.pop((event.number, _key(action))))
            case "override" | "bias" | "freeze":
                session.release(component, variable)
            case "outage":
                self._hold(component, session, hold=False)
            case "delay" | "loss":
                session.set_event_value(f"{component}.{action.kind}", math.nan)


def _earliest(instants: Sequence[int | None]) -> int | None:
    return min((each for each in instants if each is not None), default=None)


def ended_by_event(run: Run, stopped: str | None) -> Run:
    """Return the run with the event that stopped it as its reason; as it is, if none did."""
    interrupted = run.cause is not None and run.cause.kind == "interrupted"
    if stopped is None or interrupted or run.status not in ("finished", "stopped"):
        return run
    at = run.instances[0].comm_points.at_s(run.end_ns) if run.count else None
    cause = Cause("event", time_s=at, detail=stopped)
    return replace(run, status="stopped", reason=stopped, cause=cause)


def _note_outage(link: str, event: Event, session: Session, *, begins: bool) -> None:
    """Log that a link delivers nothing from now on, or delivers again."""
    level, word = ("warning", "begun") if begins else ("info", "ended")
    session.note(level, link, f"outage {word}: {event.words}")


def _key(action: Action) -> Action:
    return action._replace(value=None)
