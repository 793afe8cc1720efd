"""Check the events of a scenario against its system: bind conditions, resolve targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any, NamedTuple

from cosim.core import Findings, InputError, KeyPath, unit_in
from cosim.fmu import checked_scalars, describe_settable, may_be_set
from cosim.master import Endpoint, System
from cosim.network import PacketLink
from cosim.scenario.binding import BoundExpression, bind
from cosim.scenario.channels import Change
from cosim.scenario.events import ActionsPart, EventPart
from cosim.scenario.expression import Expression
from cosim.scenario.link_keys import nanoseconds
from cosim.scenario.matching import endpoint
from cosim.scenario.modes import ModesPart
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.scope import RunScope
from cosim.scenario.units import in_own_unit


class Action(NamedTuple):
    """One action of an event; `value` and `factor` where its kind needs them."""

    kind: str
    target: Endpoint
    value: Any = None
    factor: float = 1.0

    def __str__(self) -> str:
        words = [self.kind, str(self.target).strip(".")]
        if self.value is not None:
            words.append(f"{self.value:g}" if isinstance(self.value, float) else f"{self.value}")
        return " ".join(words)


@dataclass(frozen=True)
class Event:
    """A checked event.

    Attributes
    ----------
    number : its place among the events, those of modes behind those of the scenario.
    at_ns, condition : one of them; neither where a mode machine has it.
    ends : the condition that ends it.
    title : what it is called, where it has no condition.
    undone : whether what it does is undone when it is over.
    lasts_ns : time after which it is undone; None: never.
    stop : the reason if it ends the run.
    outages : links that deliver nothing while it lasts.
    """

    number: int
    at_ns: int | None
    condition: BoundExpression | None
    every_time: bool
    lasts_ns: int | None
    actions: tuple[Action, ...]
    stop: str | None
    outages: tuple[str, ...] = ()
    ends: BoundExpression | None = None
    title: str = ""
    undone: bool = False

    @property
    def words(self) -> str:
        """Describe the event and when it happens."""
        if self.condition is not None:
            return f"event {self.number + 1} (when {self.condition.expression.text})"
        return self.title


class Transition(NamedTuple):
    """A checked transition of a mode machine; the states by their numbers.

    condition, after_ns : both must be so; None, 0: nothing is asked.
    """

    sources: tuple[int, ...]
    target: int
    condition: BoundExpression | None
    after_ns: int


class StateEvents(NamedTuple):
    """What is done in a state, each an event: on entry, on exit, and from one to the other."""

    enter: Event | None
    exit: Event | None
    during: Event | None


@dataclass(frozen=True)
class Machine:
    """A checked mode machine.

    Attributes
    ----------
    initial : number of the state at the start.
    events : by state.
    """

    name: str
    states: tuple[str, ...]
    initial: int
    transitions: tuple[Transition, ...]
    events: tuple[StateEvents, ...]


Script = tuple[Event | Machine, ...]
"""The events of a scenario, then its mode machines."""


def adjusted_links(scenario: ScenarioPart) -> set[str]:
    """Return the links whose delay or loss is changed by conditions or in modes."""
    parts = [part for part in _all_actions(scenario) if getattr(part, "at", None) is None]
    return {name for part in parts for name in (*part.delay, *part.loss)}


def _all_actions(scenario: ScenarioPart) -> Iterator[ActionsPart]:
    """Yield what events do, then what is done in the states of modes."""
    yield from scenario.events
    states = (state for machine in scenario.modes.values() for state in machine.states.values())
    for state in states:
        yield from (each for each in (state.enter, state.exit, state.during) if each is not None)


def changes_of(scenario: ScenarioPart, findings: Findings) -> dict[str, list[Change]]:
    """Return the changes of each link by events at a time; they are known before the run."""
    found: dict[str, list[Change]] = {}
    end, begin = scenario.run.lasts_ns, scenario.run.start_ns
    for i, event in enumerate(scenario.events):
        if event.at is None or event.at > scenario.run.end:  # `script_of` refuses it
            continue
        start, lasts = nanoseconds(event.at) - begin, _lasts_ns(event)
        until = end + 1 if lasts is None else start + lasts
        for key, names in (("outage", event.outage), ("delay", event.delay), ("loss", event.loss)):
            for name in names:
                if name not in scenario.links:
                    continue  # `script_of` refuses it
                with findings.at("events", i, key):
                    delay = nanoseconds(event.delay[name]) if key == "delay" else None
                    loss = event.loss[name] if key == "loss" else None
                    found.setdefault(name, []).append(Change(start, until, delay, loss))
    return found


def instants_ns(scenario: ScenarioPart) -> list[int]:
    """Return when events at a time begin and end: these become communication points."""
    found = set()
    for event in scenario.events:
        if event.at is not None:
            start = nanoseconds(event.at) - scenario.run.start_ns
            found |= {start, start + (_lasts_ns(event) or 0)}
    return sorted(t for t in found if 0 <= t <= scenario.run.lasts_ns)


def _lasts_ns(event: EventPart) -> int | None:
    if event.duration is not None:
        return nanoseconds(event.duration)
    if event.until is not None and event.at is not None:
        return nanoseconds(event.until) - nanoseconds(event.at)
    return None


def script_of(scenario: ScenarioPart, system: System, findings: Findings) -> Script:
    """Check every event and mode machine of a scenario; errors go to `findings`."""
    scope = RunScope(system, changed_by(scenario))
    events: list[Event | Machine] = []
    for i, part in enumerate(scenario.events):
        with findings.at("events", i):
            _check_time(part, scenario)
        condition = None
        if part.when is not None:
            condition = bind_condition(scope, findings, part.when, "events", i, "when")
        ends = None
        if part.ends is not None:
            ends = bind_condition(scope, findings, part.ends, "events", i, "ends")
        events.append(
            Event(
                number=i,
                at_ns=None if part.at is None else nanoseconds(part.at) - scenario.run.start_ns,
                condition=condition,
                every_time=part.trigger == "every-time",
                lasts_ns=_lasts_ns(part),
                actions=tuple(
                    _actions(
                        part, ("events", i), system, scope, findings, timed=part.at is not None
                    )
                ),
                stop=_stop_of(part),
                outages=tuple(part.outage),
                ends=ends,
                title="" if part.at is None else f"event {i + 1} (at {part.at:g} s)",
                undone=part.ends is not None or _lasts_ns(part) is not None,
            )
        )
    numbers = count(len(events))
    for name, machine in scenario.modes.items():
        with findings.at("modes", name):
            if name in system.components or name in system.links or name == "t":
                raise InputError(
                    f"{name!r} is the name of something else",
                    expected="a name that no component and no link has",
                )
        events.append(_machine(name, machine, numbers, system, scope, findings))
    return tuple(events)


def _stop_of(part: ActionsPart) -> str | None:
    """Return the reason for which it ends the run, "" where it gives none; None if it does not."""
    return None if part.stop is None else "" if part.stop is True else part.stop


def changed_by(scenario: ScenarioPart) -> list[Endpoint]:
    """Return the variables that are set during the run."""
    return [endpoint(target) for part in _all_actions(scenario) for target in part.set]


def _machine(
    name: str,
    part: ModesPart,
    numbers: Iterator[int],
    system: System,
    scope: RunScope,
    findings: Findings,
) -> Machine:
    """Check a mode machine; `numbers` : of its events."""
    states = tuple(part.states)
    events = []
    for state, inside in part.states.items():
        made: list[Event | None] = []
        for key, word in (("enter", "enters"), ("exit", "leaves"), ("during", "is in")):
            actions = getattr(inside, key)
            if actions is None:
                made.append(None)
                continue
            path = "modes", name, "states", state, key
            done = tuple(_actions(actions, path, system, scope, findings, timed=False))
            title = f"{name} {word} {state}"
            made.append(
                Event(
                    *(next(numbers), None, None, False, None, done),
                    stop=_stop_of(actions),
                    outages=tuple(actions.outage),
                    title=title,
                    undone=key == "during",
                )
            )
        events.append(StateEvents(*made))
    transitions = []
    for i, each in enumerate(part.transitions):
        condition = None
        if each.when is not None:
            where = "modes", name, "transitions", i, "when"
            condition = bind_condition(scope, findings, each.when, *where)
        sources = tuple(states.index(source) for source in each.sources(states))
        after_ns = 0 if each.after is None else nanoseconds(each.after)
        transitions.append(Transition(sources, states.index(each.target), condition, after_ns))
    first = states.index(part.first)
    return Machine(name, states, first, tuple(transitions), tuple(events))


def bind_condition(
    scope: RunScope, findings: Findings, text: str, *path: str | int
) -> BoundExpression | None:
    """Bind the condition at some path of the scenario; None if it is refused."""
    with findings.at(*path):
        return bind(Expression(text), scope)
    return None


def _check_time(part: EventPart, scenario: ScenarioPart) -> None:
    if part.at is not None and part.at < scenario.run.start:
        raise InputError(
            "this event is before the start of the run",
            where="at",
            expected=f"at least {scenario.run.start:g} s (run.start)",
            got=f"{part.at:g} s",
        )
    if part.at is not None and part.at > scenario.run.end:
        raise InputError(
            "this event is after the end of the run",
            where="at",
            expected=f"at most {scenario.run.end:g} s (run.end)",
            got=f"{part.at:g} s",
            hint=f"an earlier event, or a longer run: end = {part.at + 1:g}",
        )


def _actions(
    part: ActionsPart,
    path: KeyPath,
    system: System,
    scope: RunScope,
    findings: Findings,
    *,
    timed: bool,
) -> Iterator[Action]:
    """Yield the actions at a path of the scenario; `timed` : links are changed before the run."""
    for reference, value in part.set.items():
        with findings.at(*path, "set", reference):
            yield _set(system, scope, endpoint(reference), value)
    for reference, value in part.override.items():
        with findings.at(*path, "override", reference):
            end = _signal(scope, reference)
            yield Action("override", end, _number(system, scope, end, value))
    for reference, bias in part.bias.items():
        with findings.at(*path, "bias", reference):
            end = _signal(scope, reference)
            yield Action("bias", end, _offset(system, scope, end, bias.offset), bias.factor)
    for key, references in (("freeze", part.freeze), ("release", part.release)):
        for k, reference in enumerate(references):
            with findings.at(*path, key, k):
                yield Action(key, _signal(scope, reference))
    for k, name in enumerate(part.reset):
        with findings.at(*path, "reset", k):
            yield _reset(system, name)
    yield from _link_settings(part, path, system, findings, timed=timed)


def _link_settings(
    part: ActionsPart, path: KeyPath, system: System, findings: Findings, *, timed: bool
) -> Iterator[Action]:
    for key, names in (("outage", part.outage), ("restore", part.restore)):
        for k, name in enumerate(names):
            with findings.at(*path, key, k):
                if name not in system.links:
                    raise InputError.unknown("link", name, system.links)
                if not timed:
                    yield _outage(system, key, name)
    for key, changed in (("delay", part.delay), ("loss", part.loss)):
        for name, number in {} if timed else changed.items():
            with findings.at(*path, key, name):
                if name not in system.links:
                    raise InputError.unknown("link", name, system.links)
                if not isinstance(system.links[name], PacketLink):
                    raise InputError(
                        "a condition changes packet links only",
                        expected='kind = "packet", or at (a time) in place of when',
                        got=f"link {name!r}: a continuous signal has no messages",
                    )
                yield Action(key, Endpoint(name, ""), float(number))


def _set(system: System, scope: RunScope, end: Endpoint, value: Any) -> Action:
    if end.component not in system.components:
        of_links = end.component in {"link", "links", *system.links}
        hint = "delay, loss, outage and restore change a link: delay = { up = 1.0 }"
        raise InputError.unknown(
            "component", end.component, system.components, hint=hint if of_links else None
        )
    fmu = system.components[end.component].description
    port = fmu.port(end.variable, where=f"component {end.component!r}")
    if end.variable in scope.signals(end.component):
        raise InputError(
            f"{end} is an output"
            if port.causality == "output"
            else f"{end} is connected: its value would be overwritten at the next point",
            expected="a tunable parameter, or an unconnected input",
            hint="override it, or set what drives it",
        )
    if not may_be_set(port, "stepping"):
        raise InputError(f"{end} cannot be set during a run", got=describe_settable(port))
    own = in_own_unit(fmu, port, value)
    checked_scalars(port, own, str(end))
    return Action("set", end, own)


def _signal(scope: RunScope, reference: str) -> Endpoint:
    end = endpoint(reference)
    signals = scope.signals(end.component)
    if end.variable not in signals:
        raise InputError.unknown("output or connected input", end.variable, signals)
    if signals[end.variable].kind == "string":
        raise InputError(f"{end} is a text, which cannot be replaced", expected="a number")
    return end


def _number(system: System, scope: RunScope, end: Endpoint, value: Any) -> float:
    port = scope.signals(end.component)[end.variable]
    return float(in_own_unit(system.components[end.component].description, port, value))


def _offset(system: System, scope: RunScope, end: Endpoint, value: Any) -> float:
    """Convert a difference: of a unit with an offset, such as degC, only the factor counts."""
    found = _number(system, scope, end, value)
    unit = unit_in(value) if isinstance(value, str) else None
    return found if unit is None else found - _number(system, scope, end, f"0 {unit}")


def _reset(system: System, name: str) -> Action:
    if name not in system.components:
        raise InputError.unknown("component", name, system.components)
    return Action("reset", Endpoint(name, ""))


def _outage(system: System, kind: str, name: str) -> Action:
    link_ports = [system.port(c.source) for c in system.connections if c.link == name]
    if any(port.kind == "string" for port in link_ports):
        raise InputError(f"link {name!r} carries texts, which a condition cannot hold")
    return Action(kind, Endpoint(name, ""))
