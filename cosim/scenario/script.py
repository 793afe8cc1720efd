"""Check the events of a scenario against its system: bind conditions, resolve targets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from cosim.core import InputError
from cosim.fmu import checked_scalars, describe_settable, may_be_set
from cosim.master import Endpoint, System
from cosim.scenario.binding import BoundExpression, bind
from cosim.scenario.channels import Change
from cosim.scenario.events import EventPart
from cosim.scenario.expression import Expression
from cosim.scenario.link_keys import nanoseconds
from cosim.scenario.matching import endpoint
from cosim.scenario.origin import Findings
from cosim.scenario.quantity import unit_in
from cosim.scenario.schema import Scenario
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
    number : its place in the scenario.
    at_ns, condition : one of them.
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

    @property
    def words(self) -> str:
        """Describe the event and when it happens."""
        if self.condition is not None:
            return f"event {self.number + 1} (when {self.condition.expression.text})"
        return f"event {self.number + 1} (at {(self.at_ns or 0) / 1e9:g} s)"


def changes_of(scenario: Scenario, findings: Findings) -> dict[str, list[Change]]:
    """Return the changes of each link by events at a time; they are known before the run."""
    found: dict[str, list[Change]] = {}
    end = nanoseconds(scenario.run.end)
    for i, event in enumerate(scenario.events):
        if event.at is None:
            continue
        start, lasts = nanoseconds(event.at), _lasts_ns(event)
        until = end + 1 if lasts is None else start + lasts
        for key, names in (("outage", event.outage), ("delay", event.delay), ("loss", event.loss)):
            for name in names:
                with findings.at("events", i, key):
                    if name not in scenario.links:
                        raise InputError.unknown("link", name, scenario.links)
                    delay = nanoseconds(event.delay[name]) if key == "delay" else None
                    loss = event.loss[name] if key == "loss" else None
                    found.setdefault(name, []).append(Change(start, until, delay, loss))
    return found


def instants_ns(scenario: Scenario) -> list[int]:
    """Return when events at a time begin and end: these become communication points."""
    found = set()
    for event in scenario.events:
        if event.at is not None:
            start = nanoseconds(event.at)
            found |= {start, start + (_lasts_ns(event) or 0)}
    return sorted(t for t in found if 0 <= t <= nanoseconds(scenario.run.end))


def _lasts_ns(event: EventPart) -> int | None:
    if event.duration is not None:
        return nanoseconds(event.duration)
    if event.until is not None and event.at is not None:
        return nanoseconds(event.until) - nanoseconds(event.at)
    return None


def script_of(scenario: Scenario, system: System, findings: Findings) -> tuple[Event, ...]:
    """Check every event of a scenario; errors go to `findings`."""
    changed = [endpoint(target) for event in scenario.events for target in event.set]
    scope = RunScope(system, changed)
    events = []
    for i, part in enumerate(scenario.events):
        with findings.at("events", i):
            _check_time(part, scenario)
        condition = None
        if part.when is not None:
            condition = bind_condition(scope, findings, part.when, "events", i, "when")
        events.append(
            Event(
                number=i,
                at_ns=None if part.at is None else nanoseconds(part.at),
                condition=condition,
                every_time=part.trigger == "every-time",
                lasts_ns=_lasts_ns(part),
                actions=tuple(_actions(part, i, system, scope, findings)),
                stop=None if part.stop is None else "" if part.stop is True else part.stop,
                outages=tuple(part.outage),
            )
        )
    return tuple(events)


def bind_condition(
    scope: RunScope, findings: Findings, text: str, *path: str | int
) -> BoundExpression | None:
    """Bind the condition at some path of the scenario; None if it is refused."""
    with findings.at(*path):
        return bind(Expression(text), scope)
    return None


def _check_time(part: EventPart, scenario: Scenario) -> None:
    if part.at is not None and part.at > scenario.run.end:
        raise InputError(
            "this event is after the end of the run",
            where="at",
            expected=f"at most {scenario.run.end:g} s (run.end)",
            got=f"{part.at:g} s",
        )


def _actions(
    part: EventPart, i: int, system: System, scope: RunScope, findings: Findings
) -> Iterator[Action]:
    for reference, value in part.set.items():
        with findings.at("events", i, "set", reference):
            yield _set(system, scope, endpoint(reference), value)
    for reference, value in part.override.items():
        with findings.at("events", i, "override", reference):
            end = _signal(scope, reference)
            yield Action("override", end, _number(system, scope, end, value))
    for reference, bias in part.bias.items():
        with findings.at("events", i, "bias", reference):
            end = _signal(scope, reference)
            yield Action("bias", end, _offset(system, scope, end, bias.offset), bias.factor)
    for k, reference in enumerate(part.release):
        with findings.at("events", i, "release", k):
            yield Action("release", _signal(scope, reference))
    for k, name in enumerate(part.reset):
        with findings.at("events", i, "reset", k):
            yield _reset(system, name)
    for key, names in (("outage", part.outage), ("restore", part.restore)):
        for k, name in enumerate(names):
            with findings.at("events", i, key, k):
                if name not in system.links:
                    raise InputError.unknown("link", name, system.links)
                if part.when is not None:
                    yield _outage(system, key, name)


def _set(system: System, scope: RunScope, end: Endpoint, value: Any) -> Action:
    if end.component not in system.components:
        raise InputError.unknown("component", end.component, system.components)
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
