"""Run a session from one event to the next and execute the events."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

from cosim.core import InputError
from cosim.master import ComponentInstance, Connection, Pace, Run, Session, System
from cosim.scenario.scope import RunScope
from cosim.scenario.script import Action, Event
from cosim.trace import Cause


class Due(NamedTuple):
    """Begin or end of an event at an instant; ends come first, then the scenario's order."""

    time_ns: int
    begins: bool
    number: int
    turn: int


class LatestValues:
    """Gives conditions the values of the last complete row."""

    def __init__(self, scope: RunScope, instances: Sequence[ComponentInstance]) -> None:
        self._scope, self._instances = scope, instances

    @cached_property
    def _places(self) -> dict[str, tuple[ComponentInstance, int, bool]]:
        """By name the instance, the number among its outputs or inputs, and whether it is one."""
        return {
            f"{instance.name}.{column.name}": (instance, j, is_input)
            for instance in self._instances
            for is_input, columns in (
                (False, instance.output_columns),
                (True, instance.input_columns),
            )
            for j, column in enumerate(columns)
        }

    def value(self, name: str, session: Session) -> float:
        """Return the value of a name in the last complete row."""
        k = session.rows - 1
        if name == "t":
            return session.row_time_ns / 1e9
        if name in self._places:
            instance, j, is_input = self._places[name]
            if is_input:
                session.make_rows_whole()
            rows = instance.inputs if is_input else instance.outputs
            return float(rows[instance.own_points.last[k], j])
        constant = self._scope.constant(name)
        if constant is not None:
            return constant
        link, _, what = name.partition(".")
        return float(getattr(session.link_state(link), "age_s" if what == "age" else what)[0])

    def inputs_of(self, connection: Connection) -> list[str]:
        """Return the names of the elements of a connection's target."""
        name, variable = connection.target
        return [
            place.removeprefix(f"{name}.")
            for place, (instance, j, is_input) in self._places.items()
            if is_input
            and instance.name == name
            and instance.input_columns[j].port.name == variable
        ]


class EventDriver:
    """Executes the events of a run.

    Attributes
    ----------
    stopped : why an event ended the run; None if none did.
    altered_by_events : whether an event changed anything but the traffic of links.
    event_counts : how often each event happened.
    """

    def __init__(self, system: System, events: Sequence[Event], rows: LatestValues) -> None:
        self._system, self._events, self._rows = system, events, rows
        self._due: list[Due] = []
        self._turn = 0
        self._before = dict.fromkeys((e.number for e in events), False)
        self._saved: dict[tuple[int, Action], Any] = {}
        self.stopped: str | None = None
        self.altered_by_events = False
        self.event_counts = [0] * len(events)
        for event in events:
            if event.at_ns is not None:
                self._plan(event.at_ns, event.number, begins=True)

    def drive(self, session: Session, pace: Pace | None = None) -> None:
        """Run to the end, or to where an event stops it."""
        self.advance(session, pace=pace)

    def advance(
        self,
        session: Session,
        until_ns: int | None = None,
        *,
        stop: Callable[[Session], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Continue as `Session.run_until`, and execute the events on the way."""
        watched = [e for e in self._events if e.condition is not None]
        stopped = False

        def look(now: Session) -> bool:
            nonlocal stopped
            found = self._look(now, watched)
            stopped = stop is not None and stop(now)
            return found or stopped

        while not session.ended and self.stopped is None:
            self.execute_due(session)
            reached = until_ns is not None and session.time_ns >= until_ns
            if self.stopped is not None or reached or stopped:
                break
            instants = [*(due.time_ns for due in self._due[:1]), until_ns]
            until = min((each for each in instants if each is not None), default=None)
            Session.run_until(
                session,
                None if until is None else until / 1e9,
                stop=look if watched or stop is not None else None,
                pace=pace,
            )
        return stopped

    def execute_due(self, session: Session) -> None:
        """Execute the events that are due at the time of the session."""
        while self._due and self._due[0].time_ns <= session.time_ns and not self.stopped:
            self._happen(heapq.heappop(self._due), session)

    def state(self) -> dict[str, Any]:
        """Return what has happened and what is due, JSON-safe, for `restore`."""
        return {
            "events": [event.words for event in self._events],
            "due": [list(due) for due in sorted(self._due)],
            "turn": self._turn,
            "before": [self._before[event.number] for event in self._events],
            "saved": [
                [number, self._key_place(number, key), value]
                for (number, key), value in self._saved.items()
            ],
            "stopped": self.stopped,
            "altered": self.altered_by_events,
            "counts": list(self.event_counts),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Return to a state of these events.

        Raises
        ------
        InputError : a state of other events.
        """
        words = [event.words for event in self._events]
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
            (number, _key(self._events[number].actions[place])): value
            for number, place, value in state["saved"]
        }
        self.stopped, self.altered_by_events = state["stopped"], state["altered"]
        self.event_counts = list(state["counts"])

    def _key_place(self, number: int, key: Action) -> int:
        return [_key(action) for action in self._events[number].actions].index(key)

    def _plan(self, time_ns: int, number: int, *, begins: bool) -> None:
        self._turn += 1
        heapq.heappush(self._due, Due(time_ns, begins, number, self._turn))

    def _look(self, session: Session, watched: Sequence[Event]) -> bool:
        """Plan events whose condition became true in the last row; whether there are any."""
        found = False
        for event in watched:
            condition = event.condition
            assert condition is not None  # noqa: S101 - those with one are watched
            now = bool(condition([self._rows.value(n, session) for n in condition.names]))
            rising = now and not self._before[event.number]
            self._before[event.number] = now
            if rising and (event.every_time or not self.event_counts[event.number]):
                found = True
                self._plan(session.time_ns, event.number, begins=True)
        return found

    def _happen(self, due: Due, session: Session) -> None:
        event = self._events[due.number]
        if not due.begins:
            for action in event.actions:
                self._undo(event, action, session)
            session.note("info", "scenario", f"{event.words} is over")
            for link in event.outages:
                _note_outage(link, event, session, begins=False)
            return
        self.event_counts[event.number] += 1
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
                Session.step(session)  # the point of its time is the last one
            self.stopped = f"stopped at t = {session.row_time_ns / 1e9:g} s by {event.words}" + (
                f": {event.stop}" if event.stop else ""
            )
            session.note("info", "scenario", self.stopped, time_ns=session.row_time_ns)

    def _act(self, event: Event, action: Action, session: Session) -> None:
        component, variable = action.target
        self.altered_by_events = True
        match action.kind:
            case "set":
                if event.lasts_ns is not None:
                    key = event.number, _key(action)
                    self._saved.setdefault(key, session.read(component, variable))
                session.set(component, variable, action.value)
            case "override":
                session.override(component, variable, action.value)
            case "bias":
                session.bias(component, variable, action.value, action.factor)
            case "release":
                session.release(component, variable)
            case "reset":
                session.reset(component)
            case "outage" | "restore":
                self._hold(component, session, hold=action.kind == "outage")
                if action.kind == "restore":
                    _note_outage(component, event, session, begins=False)

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
            case "override" | "bias":
                session.release(component, variable)
            case "outage":
                self._hold(component, session, hold=False)


def ended_by_event(run: Run, stopped: str | None) -> Run:
    """Return the run with the event that stopped it as its reason; as it is, if none did."""
    interrupted = run.cause is not None and run.cause.kind == "interrupted"
    if stopped is None or interrupted or run.status not in ("finished", "stopped"):
        return run
    at = run.end_ns / 1e9 if run.count else None
    cause = Cause("event", time_s=at, detail=stopped)
    return replace(run, status="stopped", reason=stopped, cause=cause)


def _note_outage(link: str, event: Event, session: Session, *, begins: bool) -> None:
    """Log that a link delivers nothing from now on, or delivers again."""
    level, word = ("warning", "begun") if begins else ("info", "ended")
    session.note(level, link, f"outage {word}: {event.words}")


def _key(action: Action) -> Action:
    return action._replace(value=None)
