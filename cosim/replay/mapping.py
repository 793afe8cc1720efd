"""Map recorded signals to the inputs of an FMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.scenario import ScenarioPart
from cosim.trace import Trace
from cosim.trace.rows import GREATEST_AGE, component_of, input_topic, link_topic, output_topic


@dataclass(frozen=True, slots=True)
class Source:
    """A recorded signal.

    Attributes
    ----------
    name : as for `Trace.signal`.
    topic, column : of its rows.
    """

    name: str
    topic: str
    column: str


@dataclass(frozen=True, slots=True)
class SignalMapping:
    """The mapping that a user requests.

        >>> from cosim import DelaySystem, Scenario, inject, run
        >>> from cosim.replay import InjectionRequest, SignalMapping
        >>> lag = DelaySystem([[-1]], [[1]])
        >>> first = Scenario(step=0.1, until=1).add("first", lag, initial=[1.0])
        >>> result = run(first, "first.mcap")
        >>> mapping = SignalMapping(signals=[("first.x[1]", "u[1]")])
        >>> injected = inject("first.mcap", lag, "second.mcap", InjectionRequest(mapping))
        >>> injected.sources["u[1]"].name, injected.status
        ('first.x[1]', 'finished')

    Attributes
    ----------
    signals, groups : recorded name -> input of the FMU; a group means all its members.
    role : the recorded component that the FMU stands for; None: found by its inputs.
    """

    signals: Sequence[tuple[str, str]] = ()
    groups: Sequence[tuple[str, str]] = ()
    role: str | None = None


def recorded_inputs(trace: Trace) -> dict[str, list[str]]:
    """Return the names of the recorded inputs of each component."""
    found = {}
    for topic, info in trace.topics.items():
        component = component_of(topic)
        if component and topic == input_topic(component):
            found[component] = [signal.name for signal in info.signals]
    return found


def role_of(trace: Trace, fmu: FmuDescription, role: str | None) -> str | None:
    """Return the recorded component with the most inputs in common; None if none has any.

    Raises
    ------
    InputError : the given role was not recorded, or several components fit equally well.
    """
    recorded = recorded_inputs(trace)
    if role is not None:
        if role not in recorded:
            raise InputError.unknown("recorded component", role, recorded, where="`as_component`")
        return role
    mine = set(_inputs(fmu))
    fitting = {name: len(mine & set(signals)) for name, signals in recorded.items()}
    most = max(fitting.values(), default=0)
    best = [name for name, count in fitting.items() if count == most and most]
    if len(best) > 1:
        raise InputError(
            "several recorded components have the inputs of this FMU",
            where=str(fmu.path),
            expected="one of them, chosen by `as_component`",
            got=", ".join(best),
        )
    return best[0] if best else None


def mapped(
    trace: Trace, fmu: FmuDescription, signal_mapping: SignalMapping, role: str | None
) -> dict[str, Source]:
    """Return the source of each input that has one.

    Without signals and groups, or with a requested role, inputs get what the recorded component
    of that role received under the same names; signals and groups override this.

    Raises
    ------
    InputError : nothing fits, or an unknown signal or input.
    """
    inputs = _inputs(fmu)
    found: dict[str, Source] = {}
    explicit = [*signal_mapping.signals, *signal_mapping.groups]
    if role is not None and (signal_mapping.role is not None or not explicit):
        for signal in trace.topics[input_topic(role)].signals:
            if signal.name in inputs and signal.kind != "string":
                found[signal.name] = _source(trace, f"{role}.{signal.name}")
    for group, target in signal_mapping.groups:
        found |= _members(trace, fmu, group, target)
    for name, target in signal_mapping.signals:
        if target not in inputs:
            raise InputError.unknown("input", target, inputs, where=f"`map`, {fmu.path.name}")
        found[target] = _source(trace, name)
    if not found:
        raise InputError(
            "no recorded signal fits an input of this FMU",
            where=str(fmu.path),
            expected=f"inputs of the same names as recorded ones, or `map`: {', '.join(inputs)}",
            got="; ".join(f"{c}: {', '.join(n)}" for c, n in recorded_inputs(trace).items())
            or f"signals {', '.join(list(trace.signals)[:8])}",
            hint='`map` "plant.eta.x=eta.x", `map_group` plant.eta=eta',
        )
    return found


def _inputs(fmu: FmuDescription) -> list[str]:
    """Return the inputs that can follow a recorded signal: numbers and truth values."""
    return [
        p.name
        for p in fmu.ports.values()
        if p.causality == "input" and p.kind in ("float", "int", "bool") and not p.shape
    ]


def _source(trace: Trace, name: str) -> Source:
    return Source(name, *trace.place(name))


def _members(trace: Trace, fmu: FmuDescription, group: str, target: str) -> dict[str, Source]:
    inputs = set(_inputs(fmu))
    found = {}
    for name in trace.signals:
        suffix = name[len(group) :]
        if name.startswith(group) and suffix[:1] in (".", "[") and target + suffix in inputs:
            found[target + suffix] = _source(trace, name)
    if not found:
        raise InputError(
            "the group has no members on both sides",
            where=f"`map_group` {group}={target}",
            expected=f"signals {group}.* or {group}[*], and inputs {target}.* or {target}[*]",
            got=f"inputs {', '.join(sorted(inputs))}",
        )
    return found


def as_delivered(trace: Trace, source: Source) -> Source:
    """Return the source as delivered: for an output, the link that carried it.

    Raises
    ------
    InputError : several links carried it, or one with a substitute for lost values.
    """
    if component_of(source.topic) is None or source.topic.endswith("/input"):
        return source
    links = [
        link
        for link in trace.link_names
        if any(s.name == source.name for s in trace.topics[link_topic(link)].signals)
    ]
    if not links:
        return source  # connected without a link
    link = link_topic(links[0])
    if len(links) > 1:
        raise InputError(
            f"several links carried {source.name}",
            where="`map`",
            expected="one of them",
            got=", ".join(f"{link_topic(name)}:{source.name}" for name in links),
        )
    metadata = trace.topics[link].metadata
    if metadata.get("on_loss", "hold") != "hold" or GREATEST_AGE in metadata:
        raise InputError(
            f"the receiver of {source.name} used other values than those delivered",
            where="`map`",
            got=f"link {links[0]} substitutes lost or old values",
            hint="map the receiver's input: COMPONENT.INPUT=...",
        )
    return Source(source.name, link, source.name)


def as_sent(trace: Trace, source: Source, scenario: ScenarioPart | None) -> tuple[Source, bool]:
    """Return the source as sent, and whether it has a sender: a reference has none.

    scenario : of the run; its connections name the senders.
    """
    component = component_of(source.topic)
    if source.topic.startswith(link_topic("")) and source.column in trace.signals:
        return _source(trace, source.column), True
    if component is None or source.topic == output_topic(component):
        return source, component is not None
    for part in scenario.connections if scenario is not None else ():
        target = part.target
        suffix = source.name[len(target) :]
        sender = part.source + suffix
        fits = source.name.startswith(target) and suffix[:1] in ("", ".", "[")
        if fits and sender in trace.signals:
            return _source(trace, sender), True
    return source, False


def unmapped_inputs(fmu: FmuDescription, sources: Mapping[str, Source]) -> list[str]:
    """Return the inputs that keep their start values."""
    return [name for name in _inputs(fmu) if name not in sources]
