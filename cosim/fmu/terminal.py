"""Terminals of an FMU: variables that are connected together (FMI 3.0.2 2.4.9, FMI 2.0.4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Terminal:
    """Variables that are connected together, by the names of members.

    Attributes
    ----------
    rule : how they meet those of another terminal, such as "plug".
    kind : what it is a terminal for; both ends have the same. None: not said.
    members : name of a member -> variable; those of a terminal inside have its name in front.
    """

    name: str
    rule: str
    kind: str | None
    members: Mapping[str, str]


def declared_terminals(root: Any) -> dict[str, Terminal]:
    """Return the terminals of terminalsAndIcons.xml by name; one inside another one as `a.b`."""
    holder = root.find("Terminals")
    return {one.name: one for one in (() if holder is None else _terminals(holder, ""))}


def _terminals(parent: Any, prefix: str) -> Iterator[Terminal]:
    for element in parent.iterchildren("Terminal"):
        name = prefix + element.get("name", "")
        inside = list(_terminals(element, f"{name}."))
        members = dict(_members(element))
        for one in inside:
            own = one.name.removeprefix(f"{name}.")
            members |= {f"{own}.{member}": variable for member, variable in one.members.items()}
        yield Terminal(name, element.get("matchingRule", ""), element.get("terminalKind"), members)
        yield from inside


def _members(element: Any) -> Iterator[tuple[str, str]]:
    """Give name and variable of each member; in a sequence, where a name may be missing, its place.

    Variables that are no signals or flows, such as streams, are not connected here.
    """
    for place, member in enumerate(element.iterchildren("TerminalMemberVariable")):
        if (variable := member.get("variableName")) is not None:
            yield member.get("memberName", str(place)), variable
