"""Draw a scenario as a diagram: text for a terminal, or Mermaid."""

from __future__ import annotations

from itertools import pairwise

from cosim.scenario.links import (
    LinkPart as Link,
    PacketPart,
    ProfilePart,
    RangeDelayPart,
    SignalDelayPart,
)
from cosim.scenario.schema import ConnectionPart, ScenarioPart


def as_text(scenario: ScenarioPart) -> str:
    """Return components, links and connections, one per line.

        >>> from cosim import Scenario
        >>> from cosim.scenario import as_text
        >>> print(as_text(Scenario.load("paper-example").loaded().scenario))
        components
          [plant]       DelayedPlant
          [controller]  PaperController
          [exosystem]   WaveField
        connections
          exosystem.disturbance.u --> plant.w[1]
          plant.x                 --> controller.x
          controller.u            --> plant.u

    scenario : `Scenario.loaded().scenario`.
    """
    lines = ["components"]
    wide = max(map(len, scenario.components))
    for name, part in scenario.components.items():
        step = f", steps of {part.step:g} s" if part.step is not None else ""
        lines.append(f"  [{name}]{' ' * (wide - len(name))}  {part.fmu}{step}")
    values = [f"  {n}.{o} = {x}" for n, p in scenario.computed.items() for o, x in p.items()]
    lines += ["computed", *values] if values else []
    if scenario.links:
        lines.append("links")
    for link, of in scenario.links.items():
        lines.append(f"  ({link})  {link_words(of)}")
    lines.append("connections")
    ends = [(part.source, part.target, _ways(part)) for _, part in scenario.wires()]
    ends += [("path", path.target, []) for _, path in scenario.paths()]
    ends += [("series", name, []) for part in scenario.inputs for name in part.values or ()]
    if scenario.disturbance is not None:
        ends.append((scenario.disturbance.kind, scenario.disturbance.target, []))
    wide = max((len(source) for source, _, _ in ends), default=0)
    for source, target, over in ends:
        arrow = "--".join(["", *over, ">"])
        lines.append(f"  {source.ljust(wide)} {arrow} {target}")
    for name, machine in scenario.modes.items():
        lines.append(f"modes of {name}: {', '.join(machine.states)}")
        for each in machine.transitions:
            sources = ", ".join(each.sources(machine.states))
            lines.append(f"  {sources} --> {each.target}  {each.words}")
    return "\n".join(lines)


def _ways(part: ConnectionPart) -> list[str]:
    """Return what the values of a connection pass, each as it is drawn."""
    sensor = [f"[{part.sensor}]"] if part.sensor else []
    return sensor + ([f"({part.link})"] if part.link else [])


def as_mermaid(scenario: ScenarioPart) -> str:
    """Return a Mermaid flowchart."""
    lines = ["flowchart LR"]
    made = {
        **dict.fromkeys(scenario.computed, "computed"),
        **dict.fromkeys(scenario.sensors, "sensor"),
    }
    number = {name: f"c{i}" for i, name in enumerate([*scenario.components, *made])}
    lines += [f'  {number[name]}["{name}<br/>{kind}"]' for name, kind in made.items()]
    for name, part in scenario.components.items():
        lines.append(f'  {number[name]}["{name}<br/>{part.fmu}"]')
    for i, (link, of) in enumerate(scenario.links.items()):
        number[link] = f"l{i}"
        lines.append(f'  l{i}(["{link}<br/>{link_words(of)}"])')
    drawn: dict[tuple[str, str], list[str]] = {}
    for _, wire in scenario.wires():
        source, _, what = wire.source.partition(".")
        target = wire.target.partition(".")[0]
        way = [source, *(name for name in (wire.sensor, wire.link) if name), target]
        for a, b in pairwise(way):
            drawn.setdefault((a, b), []).append(what)
    for (a, b), whats in drawn.items():
        lines.append(
            f'  {number.get(a, a)} -->|"{", ".join(dict.fromkeys(whats))}"| {number.get(b, b)}'
        )
    for i, (_, path) in enumerate(scenario.paths()):
        target = path.target.partition(".")[0]
        name = f"path{i or ''}"
        lines.append(f'  {name}(["reference path"]) --> {number.get(target, target)}')
    for m, (name, machine) in enumerate(scenario.modes.items()):
        lines.append(f"  subgraph m{m} [{name}]")
        place = {state: f"m{m}s{i}" for i, state in enumerate(machine.states)}
        lines += [f'    {place[state]}(("{state}"))' for state in machine.states]
        for each in machine.transitions:
            for source in each.sources(machine.states):
                words = each.words.replace('"', "'")
                lines.append(f'    {place[source]} -->|"{words}"| {place[each.target]}')
        lines.append("  end")
    return "\n".join(lines)


def link_words(link: Link) -> str:
    """Describe a link in a few words."""
    delay = link.delay
    match delay:
        case RangeDelayPart():
            late = f"delay by the range at {delay.speed:g} m/s"
        case SignalDelayPart():
            late = f"delay by {delay.signal}"
        case ProfilePart():
            late = f"delay recorded, {min(delay.delays):g} to {max(delay.delays):g} s"
        case float() | int():
            late = f"delay {delay:g} s"
        case _:
            late = f"delay from {delay.file}"
    if not isinstance(link, PacketPart):
        return f"transport, {late}"
    if link.recording is not None:
        late = "as recorded"
    if link.medium is not None:
        late = f"over {link.medium} from {link.sender} to {link.receiver}"
    words = [f"packet each {link.sample_time:g} s", late]
    if link.jitter is not None:
        words.append(f"{link.jitter.kind} jitter")
    if link.loss:
        words.append(f"loss {link.loss:g}" if isinstance(link.loss, float) else "loss in bursts")
    return ", ".join(words)
