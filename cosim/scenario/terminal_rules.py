"""Which variables two terminals connect (FMI 3.0.2 2.4.9.2, and the layered standard for buses)."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.core import InputError
from cosim.fmu import FmuDescription, Port, Terminal
from cosim.master import Endpoint

Ends = tuple[Endpoint, Endpoint]
"""Source and target of a connection."""
TRANSCEIVER = "org.fmi-ls-bus.transceiver"
"""Rule of the layered standard for buses: what one end sends (Tx) the other one receives (Rx)."""
_OPPOSITE = {"Tx_": "Rx_", "Rx_": "Tx_"}


def joined_by_terminals(
    fmus: Mapping[str, FmuDescription], one: Endpoint, other: Endpoint
) -> list[Ends]:
    """Return what two terminals join, either way; nothing where the two ends are none.

    Raises
    ------
    InputError : terminals of two kinds or rules, or members that do not meet.
    """
    where = f"{one} -> {other}"
    terminals = [fmus[end.component].terminals.get(end.variable) for end in (one, other)]
    mine, theirs = terminals
    if mine is None or theirs is None:
        return []
    if (mine.rule, mine.kind) != (theirs.rule, theirs.kind):
        raise InputError(
            "the two terminals are of different kinds",
            where=where,
            got=" -> ".join(
                f"{t.kind or 'no kind'}, matched as {t.rule!r}" for t in (mine, theirs)
            ),
        )
    found = []
    for member, opposite in _pairs(mine, theirs, where):
        ends = (
            Endpoint(one.component, mine.members[member]),
            Endpoint(other.component, theirs.members[opposite]),
        )
        ports = [fmus[end.component].ports.get(end.variable) for end in ends]
        if _sends(ports[0]) and _receives(ports[1]):
            found.append(ends)
        elif _sends(ports[1]) and _receives(ports[0]):
            found.append(ends[::-1])
        elif any(_sends(port) or _receives(port) for port in ports):
            raise InputError(
                "these members of the terminals cannot be connected",
                where=where,
                expected="an output and an input",
                got=" and ".join(
                    f"{end}: {'no variable' if port is None else port.causality}"
                    for end, port in zip(ends, ports, strict=True)
                ),
            )
    return found


def _sends(port: Port | None) -> bool:
    return port is not None and port.is_source


def _receives(port: Port | None) -> bool:
    return port is not None and port.causality == "input" and not port.is_source


def _pairs(mine: Terminal, theirs: Terminal, where: str) -> list[tuple[str, str]]:
    """Return which members meet, by the rule of the two terminals (FMI 3.0.2 2.4.9.2)."""
    names, others = list(mine.members), list(theirs.members)
    if mine.rule == "bus":
        return [(name, name) for name in names if name in theirs.members]
    if mine.rule == "sequence":
        pairs = list(zip(names, others, strict=False))
    elif mine.rule in ("plug", TRANSCEIVER):
        opposite = {name: name for name in names}
        if mine.rule == TRANSCEIVER:
            opposite = {name: _OPPOSITE.get(name[:3], "") + name[3:] for name in names}
        pairs = [(name, other) for name, other in opposite.items() if other in theirs.members]
    else:
        raise InputError(
            "terminals cannot be connected by this rule",
            where=where,
            expected=f"plug, bus, sequence or {TRANSCEIVER}",
            got=mine.rule or "none",
            hint="connect the variables one by one",
        )
    if not len(pairs) == len(names) == len(others):
        raise InputError(
            "the two terminals do not have the same members",
            where=where,
            expected=f"{mine.name}: {', '.join(names) or 'none'}",
            got=f"{theirs.name}: {', '.join(others) or 'none'}",
            hint="connect the variables one by one",
        )
    return pairs
