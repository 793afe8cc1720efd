"""A system that a test has built, as a scenario: the same system comes about from it."""

from __future__ import annotations

from typing import Any

from cosim.master import Link, System
from cosim.network import (
    DelayProfile,
    DelaySignal,
    DurationKey,
    Medium,
    PacketLink,
    keys_of,
)


def scenario_of(system: System, **more: Any) -> dict[str, Any]:
    """The tables of a scenario of a system, and further ones."""
    schedule = system.comm_schedule
    media = {x.hop.medium.name: x.hop.medium for x in system.links.values() if _shared(x)}
    found: dict[str, Any] = {
        "title": "A system of a test",
        "run": {
            "end": schedule.end_ns / 1e9,
            "step": schedule.step_ns / 1e9,
            "events": schedule.events,
            "algorithm": system.algorithm,
            "unknown_feedthrough": system.unknown_feedthrough,
            **({} if system.divergence is None else {"divergence": system.divergence}),
        },
        "components": {
            name: {
                "fmu": str(one.description.path),
                "parameters": dict(one.parameters),
                **({} if one.every_ns is None else {"step": one.every_ns / 1e9}),
            }
            for name, one in system.components.items()
        },
        "connections": [
            {
                "from": str(c.source),
                "to": str(c.target),
                "policy": c.policy,
                **({} if c.link is None else {"link": c.link}),
            }
            for c in system.connections
        ],
        "links": {name: link_table(link, system) for name, link in system.links.items()},
        "medium": {name: _medium(medium) for name, medium in media.items()},
    }
    return {key: value for key, value in (found | more).items() if value}


def link_table(link: Link, system: System | None = None) -> dict[str, Any]:
    """[links.NAME] of a link; the signal that its delay follows is that of a system."""
    table = {"kind": "packet" if isinstance(link, PacketLink) else "transport", **_keys(link)}
    if isinstance(link.delay, DelayProfile):
        times, delays = link.delay.times_ns.tolist(), link.delay.delays_ns.tolist()
        table["delay"] = {"times": [t / 1e9 for t in times], "delays": [d / 1e9 for d in delays]}
    if isinstance(link.delay, DelaySignal) and system is not None:
        source = system.delays[link.name]
        table["delay"] = {
            "range": [str(signal) for signal in source.signals],
            "from": [x if isinstance(x, float) else str(x) for x in source.origin or ()],
            "speed": 1.0 / link.delay.scale,
            "offset": link.delay.offset_ns / 1e9,
        }
    if isinstance(link, PacketLink) and link.recording is not None:
        played = link.recording
        table["recording"] = {
            "sent": [t / 1e9 for t in played.sent_ns.tolist()],
            "lost": [k for k, lost in enumerate(played.lost.tolist()) if lost],
            **_keys(played),
        }
        if played.delay_ns is not None:
            table["recording"]["delays"] = [d / 1e9 for d in played.delay_ns.tolist()]
    if isinstance(link, PacketLink) and link.hop is not None:
        hop = link.hop
        table |= {"medium": hop.medium.name, "from": hop.sender, "to": hop.receiver}
    return table


def _shared(link: Link) -> bool:
    return isinstance(link, PacketLink) and link.hop is not None


def _medium(medium: Medium) -> dict[str, Any]:
    return {"nodes": {node.name: list(node.place) for node in medium.nodes}, **_keys(medium)}


def _keys(one: Any) -> dict[str, Any]:
    """The keys of a link, or of a part of one, with their values in a scenario."""
    found: dict[str, Any] = {}
    for name, declared in keys_of(type(one)).items():
        value = getattr(one, declared.field)
        if isinstance(declared.key, DurationKey) and value is not None:
            value /= 1e9
        elif hasattr(value, "__dataclass_fields__"):
            value = None if getattr(value, "kind", "") == "none" else _keys(value)
        if value is not None:
            found[name] = value
    return found
