"""Make components of what a scenario says about signals: computed values, sensors, maps.

    [computed.NAME]             a component NAME with these outputs
    [sensors.NAME]              a component NAME between the ends of the connections that name it
    gain, offset, matrix, add   a component to-TARGET in front of an input

They are FMUs like any other: engines, traces, reruns, events and exports need not know of them. A
value goes through the sensor first, then the map, then the link. All have direct feedthrough: a
value computed, measured or mapped at a communication point is that of the signals at this point,
without a step of delay; a circle of such values is an algebraic loop, which is refused or cut as
any other.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cosim.core import NUMBER_ONLY, TIME, Findings, InputError, KeyPath, QuantityError, is_inside
from cosim.fmu import FmuDescription, Port
from cosim.fmu.export import ComponentSpec, component_module
from cosim.master import Connection, Endpoint
from cosim.scenario.binding import Meaning, check_name
from cosim.scenario.computed import ComputedTable, unit_named
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.matching import endpoint, matched
from cosim.scenario.schema import ComponentPart, ConnectionPart, ScenarioPart
from cosim.scenario.scope import meaning_of_state
from cosim.scenario.script import changed_by
from cosim.scenario.signal_parts import SensorPart, Setting
from cosim.scenario.units import in_own_unit, in_unit_of, unit_of
from cosim.scenario.values import parse_value
from cosim.trace.rows import link_topic

_SENSOR = component_module("sensor.variables")
_SETTINGS = ("noise", "bias", "drift", "resolution", "least", "greatest")
_TOPIC_OF_LINKS = link_topic("").strip("/")


class LinearMap(NamedTuple):
    """What a component in front of an input computes: the sum of gain * signal, and an offset."""

    terms: tuple[tuple[Endpoint, float], ...]
    offset: float


class Lowered(NamedTuple):
    """A scenario in components and connections alone.

    fmus : of all its components.
    maps : the components that are a linear map and nothing else, by name.
    """

    scenario: ScenarioPart
    fmus: dict[str, FmuDescription]
    maps: dict[str, LinearMap]


def has_signal_parts(scenario: ScenarioPart) -> bool:
    """Whether a scenario has parts that become components here."""
    return bool(scenario.computed or scenario.sensors) or any(map(_has_map, scenario.connections))


def lowered(
    scenario: ScenarioPart,
    fmus: Mapping[str, FmuDescription],
    fmu_cache: FmuCache,
    findings: Findings,
) -> Lowered:
    """Return the scenario in components and connections alone, and the FMUs of all of them.

    Raises
    ------
    InputError : names, units or groups that do not fit; errors go to `findings`.
    """
    if not has_signal_parts(scenario):
        return Lowered(scenario, dict(fmus), {})
    return _Lowering(scenario, dict(fmus), fmu_cache, findings).result()


def _has_map(part: ConnectionPart) -> bool:
    mapped = part.gain is not None or part.offset is not None or part.matrix is not None
    return part.sensor is not None or mapped or part.add


@dataclass
class _Mapped:
    """What comes to one input through a map: sources with their gains, and the sum's offset."""

    target: Endpoint
    path: KeyPath
    part: ConnectionPart
    terms: list[tuple[Endpoint, float]] = field(default_factory=list)
    offset: float = 0.0


class _Lowering:
    def __init__(
        self,
        scenario: ScenarioPart,
        fmus: dict[str, FmuDescription],
        cache: FmuCache,
        findings: Findings,
    ) -> None:
        self._scenario, self._fmus, self._cache, self._findings = scenario, fmus, cache, findings
        self._parts = dict(scenario.components)
        self._pending: list[str] = []
        self._wires = scenario.wires()
        self._kept: list[ConnectionPart] = []
        self._more: list[ConnectionPart] = []
        self._maps: dict[Endpoint, _Mapped] = {}

    def result(self) -> Lowered:
        """Return the scenario and the FMUs, as `lowered`."""
        scenario = self._scenario
        self._check_names()
        if self._findings.errors:
            return self._done()
        for name in (*scenario.computed, *scenario.sensors):
            self._describe(name)
        for i, part in enumerate(scenario.connections):
            with self._findings.at("connections", i):
                self._connect(part, ("connections", i))
        for one in self._maps.values():
            with self._findings.at(*one.path):
                self._map(one)
        return self._done()

    def _check_names(self) -> None:
        """Refuse two parts of one name, and sensors that do not exist."""
        scenario = self._scenario
        taken = {*scenario.components, *scenario.links}
        for kind, parts in (("computed", scenario.computed), ("sensors", scenario.sensors)):
            for name in parts:
                with self._findings.at(kind, name):
                    if name in taken:
                        raise InputError(f"there are two parts named {name!r}", got=kind)
                    if name == _TOPIC_OF_LINKS:
                        raise InputError("in a trace this is the name of links", got=name)
            taken |= parts.keys()
        for i, part in enumerate(scenario.connections):
            if part.sensor is not None and part.sensor not in scenario.sensors:
                with self._findings.at("connections", i, "sensor"):
                    raise InputError.unknown("sensor", part.sensor, scenario.sensors)

    def _done(self) -> Lowered:
        connections = [*self._kept, *self._more]
        update = {"components": self._parts, "connections": connections}
        plain: dict[str, Any] = {"computed": {}, "sensors": {}}
        scenario = self._scenario.model_copy(update=update | plain)
        linear = {
            _map_name(one.target): LinearMap(tuple(one.terms), one.offset)
            for one in self._maps.values()
        }
        return Lowered(scenario, self._fmus, linear)

    # ---- components

    def _describe(self, name: str) -> FmuDescription | None:
        """Return the FMU of a component; make that of a computed one or a sensor."""
        scenario = self._scenario
        if name in self._fmus or (name not in scenario.computed and name not in scenario.sensors):
            return self._fmus.get(name)
        if name in self._pending:
            way = " -> ".join([*self._pending[self._pending.index(name) :], name])
            raise InputError("signals are computed from each other in a circle", got=way)
        self._pending.append(name)
        try:
            if name in scenario.computed:
                with self._findings.at("computed", name):
                    self._make_computed(name)
            else:
                with self._findings.at("sensors", name):
                    self._make_sensor(name, scenario.sensors[name])
        finally:
            self._pending.remove(name)
        return self._fmus.get(name)

    def _make_computed(self, name: str) -> None:
        texts = self._scenario.computed[name]
        table = ComputedTable(name, texts, self, self.constant)
        whole = len(self._findings.errors)
        for output in texts:
            with self._findings.at("computed", name, output):
                table.bind(output)
        if len(self._findings.errors) > whole:
            return
        units = {signal: self._port_unit(signal) for signal in table.signals}
        integers = [signal for signal in table.signals if self._is_integer(signal)]
        self._make(name, "computed", table.spec(units, self._scenario.run.step, integers), {})
        for signal in table.signals:
            self._read(signal, name)

    def _make_sensor(self, name: str, part: SensorPart) -> None:
        lanes = self._lanes(name)
        if not lanes:
            raise InputError(
                f"no connection names the sensor {name!r}",
                expected=f'sensor = "{name}" in one of [[connections]]',
            )
        values = [(lane, self._unit(end)) for end, lane in lanes.items()]
        freeze = part.freeze
        never = self._scenario.run.end * 2.0 + 1.0
        spec = _SENSOR.sensor_at_once_spec(
            name,
            values,
            {},
            uniform=part.distribution == "uniform",
            sample_time=part.sample_time,
            seed=self._scenario.run.seed if part.seed is None else part.seed,
            freeze=(0.0, 0.0) if freeze is None else (freeze.start, freeze.until or never),
            step=self._scenario.run.step,
        )
        start: dict[str, float] = {}
        for key in _SETTINGS:
            given: Setting | None = getattr(part, key)
            if given is None or given == 0.0:
                continue
            with self._findings.at("sensors", name, key):
                start |= self._settings(key, given, lanes)
        for lane in lanes.values():
            if start.get(f"least.{lane}", -float("inf")) > start.get(
                f"greatest.{lane}", float("inf")
            ):
                raise InputError(f"least is greater than greatest, of {lane}")
        self._make(name, "sensors", spec, start)
        for end, lane in lanes.items():
            self._more.append(_wire(("sensors", name), str(end), f"{name}.true.{lane}"))

    def _settings(
        self, key: str, given: Setting, lanes: Mapping[Endpoint, str]
    ) -> dict[str, float]:
        ends = {lane: end for end, lane in lanes.items()}
        for lane in given if isinstance(given, dict) else ():
            if lane not in ends:
                raise InputError.unknown("value of this sensor", lane, ends)
        each = given if isinstance(given, dict) else dict.fromkeys(ends, given)
        return {f"{key}.{lane}": self._number(key, v, ends[lane]) for lane, v in each.items()}

    def _number(self, key: str, value: Any, end: Endpoint) -> float:
        """Convert a setting to the unit of what is measured: of drift per second."""
        if not isinstance(value, str):
            return float(value)
        fmu = self._fmus[end.component]
        port = self._port(end)
        if key in ("least", "greatest"):
            return in_unit_of(fmu, port, value, key)
        unit = unit_of(fmu, port)
        wanted = None if unit is None else unit.dimension
        try:
            found = parse_value(value)
        except QuantityError as error:
            raise InputError("this is no quantity", expected=str(error), got=repr(value)) from error
        if wanted is not None and key == "drift":
            wanted = wanted * TIME.power(-1)  # type: ignore[arg-type] # Fractions take integers
        if wanted is None or unit is None:
            wanted = NUMBER_ONLY
        if found.dimension != wanted and found.dimension.without_angle() != wanted.without_angle():
            raise InputError(
                f"the {key} of {end} is measured in {wanted}",
                expected=f"a quantity in {wanted}",
                got=f"{value!r}, in {found.dimension}",
            )
        # a difference: of a unit with an offset only the factor counts
        return found.si / (1.0 if unit is None else unit.factor)

    def _lanes(self, name: str) -> dict[Endpoint, str]:
        """Return what a sensor measures: sources, each with its name there."""
        ends: dict[Endpoint, None] = {}
        for i, part in enumerate(self._scenario.connections):
            if part.sensor != name:
                continue
            with self._findings.at("connections", i):
                for connection in self._ends(part, sensor=False):
                    ends[connection.source] = None
        variables = [end.variable for end in ends]
        return {
            end: end.variable if variables.count(end.variable) == 1 else str(end) for end in ends
        }

    def _make(self, name: str, kind: str, spec: ComponentSpec, start: Mapping[str, float]) -> None:
        self._fmus[name] = self._cache.made(spec, f"{kind}.{name}")
        self._parts[name] = ComponentPart(fmu=f"[{kind}.{name}]", parameters=dict(start))

    def _unit(self, end: Endpoint) -> str | None:
        """Return the unit of a signal as FMUs made here have it."""
        port = self._port(end)
        unit = unit_of(self._fmus[end.component], port)
        if unit is None or unit.dimension is None or (unit.factor, unit.offset) != (1.0, 0.0):
            return port.unit
        return port.unit if unit.dimension.angle == 0 else unit_named(unit.dimension)

    def _is_link(self, end: Endpoint) -> bool:
        """Whether it is the state of a link, not a signal of a component of the same name."""
        return end.component in self._scenario.links and end.component not in self._parts

    def _port_unit(self, reference: str) -> str | None:
        end = endpoint(reference)
        if self._is_link(end):
            return "s" if end.variable == "age" else None
        return self._unit(end)

    def _is_integer(self, reference: str) -> bool:
        end = endpoint(reference)
        if self._is_link(end):
            return end.variable != "age"
        return self._port(end).kind == "int"

    def _port(self, end: Endpoint) -> Port:
        fmu = self._describe(end.component)
        if fmu is None:
            names = {**self._parts, **self._scenario.computed, **self._scenario.sensors}
            if end.component in names:
                raise InputError(f"the FMU of {end.component!r} was not found")
            raise InputError.unknown("component", end.component, names)
        return fmu.port(end.variable, where=f"component {end.component!r}")

    # ---- names in expressions

    def meaning(self, reference: str) -> Meaning:
        """Return the meaning of a name in [computed]."""
        end = endpoint(reference)
        if self._is_link(end):
            return meaning_of_state(end.variable)
        if not end.variable:
            check_name(reference)
        port = self._port(end)
        if port.kind not in ("float", "int") or port.shape:
            raise InputError(
                f"{reference} cannot be computed with",
                expected="a number",
                got="an array" if port.shape else f"a variable of type {port.getter_type}",
            )
        if port.causality not in ("output", "input", "parameter"):
            raise InputError(f"{reference} is neither signal nor parameter", got=port.causality)
        if port.causality == "input" and self._feeding(end) is None and not self._is_free(end):
            raise InputError(
                f"{reference} follows a given series or path",
                expected="an output, or an input that a connection leads to",
            )
        if end in changed_by(self._scenario) and self.constant(reference) is not None:
            raise InputError(f"{reference} is set by an event", expected="a signal or a constant")
        unit = unit_of(self._fmus[end.component], port)
        if unit is None:
            return Meaning("number", None)
        return Meaning("number", unit.dimension, unit.to_si)

    def constant(self, reference: str) -> float | None:
        """Return the value of a parameter or an unconnected input; None for a signal."""
        end = endpoint(reference)
        if end.component not in self._fmus:
            return None
        fmu = self._fmus[end.component]
        port = fmu.ports.get(end.variable)
        if port is None or port.causality == "output":
            return None
        if port.causality == "input" and self._feeding(end) is not None:
            return None
        value = self._parts[end.component].parameters.get(port.name, port.start)
        return float(in_own_unit(fmu, port, 0.0 if value is None else value))

    def _is_free(self, end: Endpoint) -> bool:
        """Whether an input has its start value for the whole run."""
        scenario = self._scenario
        driven = [name for part in scenario.inputs for name in (part.values or part.columns or ())]
        groups = [path.target for _, path in scenario.paths()]
        groups += [] if scenario.disturbance is None else [scenario.disturbance.target]
        return str(end) not in driven and not any(
            is_inside(str(end), group) or str(end) == group for group in groups
        )

    def _feeding(self, end: Endpoint) -> tuple[ConnectionPart, Endpoint] | None:
        """Return the connection to an input, and its source."""
        for _, part in self._wires:
            target = endpoint(part.target)
            if target.component == end.component and end.variable.startswith(target.variable):
                suffix = end.variable[len(target.variable) :]
                if suffix[:1] in ("", ".", "["):
                    source = endpoint(part.source)
                    return part, Endpoint(source.component, source.variable + suffix)
        return None

    def _read(self, signal: str, name: str) -> None:
        """Connect a signal of an expression to the component `name` that computes it."""
        path, target = ("computed", name), f"{name}.{signal}"
        end = endpoint(signal)
        found = None
        if end.component in self._fmus and self._port(end).causality == "input":
            found = self._feeding(end)
        if found is None:
            self._more.append(_wire(path, signal, target))
            return
        part, source = found
        if part.gain is not None or part.offset is not None or part.matrix is not None or part.add:
            source = Endpoint(_map_name(end), end.variable)
        elif part.sensor is not None:
            source = Endpoint(part.sensor, self._lanes(part.sensor)[source])
        self._more.append(_wire(path, str(source), target, part.link, part.policy))

    # ---- connections

    def _ends(self, part: ConnectionPart, *, sensor: bool = True) -> list[Connection]:
        """Return the connections of a part, one per variable, from what is sent or measured."""
        source, target = endpoint(part.source), endpoint(part.target)
        for end in (source, target):
            self._describe(end.component)
        found = matched(self._fmus, source, target, part.link, part.policy, self._parts)
        if sensor and part.sensor is not None:
            lanes = self._lanes(part.sensor)
            return [c._replace(source=Endpoint(part.sensor, lanes[c.source])) for c in found]
        return found

    def _connect(self, part: ConnectionPart, path: KeyPath) -> None:
        if not _has_map(part):
            self._kept.append(part.made_of(path))
            return
        if part.matrix is not None:
            self._matrix(part, path)
            return
        plain = part.gain is None and part.offset is None and not part.add
        for c in self._ends(part):
            if plain:
                ends = str(c.source), str(c.target)
                self._more.append(_wire(path, *ends, part.link, part.policy))
                continue
            one = self._maps.get(c.target)
            if one is None:
                one = self._maps[c.target] = _Mapped(c.target, path, part)
            elif not (part.add and one.part.add):
                raise InputError(
                    "an input has two sources",
                    where=str(c.target),
                    got=f"{one.part.source}, and {part.source}",
                    hint="add = true for both, to add them",
                )
            elif (part.link, part.policy) != (one.part.link, one.part.policy):
                raise InputError(
                    "connections that are added take the same link and policy",
                    where=str(c.target),
                    got=f"{one.part.link or 'no link'}, and {part.link or 'no link'}",
                    hint="a computed value takes each over its own",
                )
            one.terms.append((c.source, 1.0 if part.gain is None else part.gain))
            if part.offset is not None:
                fmu = self._fmus[c.target.component]
                one.offset += float(in_own_unit(fmu, self._port(c.target), part.offset))

    def _matrix(self, part: ConnectionPart, path: KeyPath) -> None:
        rows = part.matrix or []
        sources = self._group(part.source, "output")
        if part.sensor is not None:
            lanes = self._lanes(part.sensor)
            sources = [Endpoint(part.sensor, lanes[end]) for end in sources]
        targets = self._group(part.target, "input")
        if len(rows) != len(targets) or len(rows[0]) != len(sources):
            raise InputError(
                "the matrix does not fit the groups",
                where="matrix",
                expected=f"{len(targets)} rows of {len(sources)} numbers: "
                f"{', '.join(map(str, targets))} from {', '.join(map(str, sources))}",
                got=f"{len(rows)} rows of {len(rows[0])}",
            )
        for target, row in zip(targets, rows, strict=True):
            if target in self._maps:
                raise InputError(
                    "an input has two sources", where=str(target), hint="leave one of them out"
                )
            terms = list(zip(sources, row, strict=True))
            self._maps[target] = _Mapped(target, path, part, terms)

    def _group(self, reference: str, causality: str) -> list[Endpoint]:
        end = endpoint(reference)
        fmu = self._describe(end.component)
        if fmu is None:
            raise InputError.unknown("component", end.component, self._parts)
        found = [
            Endpoint(end.component, port.name)
            for port in fmu.ports.values()
            if port.causality == causality
            and (port.name == end.variable or is_inside(port.name, end.variable))
        ]
        if not found:
            names = [p.name for p in fmu.ports.values() if p.causality == causality]
            raise InputError.unknown(causality, end.variable, names)
        return found

    def _map(self, one: _Mapped) -> None:
        """Make the component in front of an input: the sum of gain * value, and the offset."""
        nodes: list[list[Any]] = []
        total: int | None = None
        for source, gain in one.terms:
            nodes += [["symbol", str(source)], ["constant", gain]]
            place = len(nodes) - 2
            if gain != 1.0:
                nodes.append(["*", place + 1, place])
                place = len(nodes) - 1
            if total is not None:
                nodes.append(["+", total, place])
                place = len(nodes) - 1
            total = place
        if one.offset != 0.0:
            nodes += [["constant", one.offset], ["+", total, len(nodes)]]
            total = len(nodes) - 1
        port = self._port(one.target)
        signals = list(dict.fromkeys(str(source) for source, _ in one.terms))
        text = " + ".join(f"{gain!r} * {source}" for source, gain in one.terms)
        text += f" + {one.offset!r}" if one.offset != 0.0 else ""
        name = _map_name(one.target)
        spec = component_module("computed.variables").computed_spec(
            name,
            [(signal, self._unit(endpoint(signal)), f"signal {signal}") for signal in signals],
            [(port.name, port.unit, text)],
            nodes,
            [total],
            [signals],
            self._scenario.run.step,
        )
        if name in self._parts:
            raise InputError(f"there are two parts named {name!r}")
        self._make(name, "connections", spec, {})
        self._more += [_wire(one.path, signal, f"{name}.{signal}") for signal in signals]
        ends = f"{name}.{port.name}", str(one.target)
        self._more.append(_wire(one.path, *ends, one.part.link, one.part.policy))


def _map_name(target: Endpoint) -> str:
    """Return the name of the component with the map in front of an input."""
    return re.sub(r"[^A-Za-z0-9_]+", "-", f"to-{target}").strip("-")


def _wire(
    path: KeyPath, source: str, target: str, link: str | None = None, policy: Any = "hold"
) -> ConnectionPart:
    """Return a connection that is made of the part of the scenario at a path."""
    given: dict[str, Any] = {"from": source, "to": target, "policy": policy}
    if link is not None:
        given["link"] = link
    return ConnectionPart.model_validate(given).made_of(path)
