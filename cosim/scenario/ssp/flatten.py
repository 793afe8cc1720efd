"""Nested systems as one: components by a path of names, connections from output to input."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import SSD
from cosim.scenario.ssp.parameters import BoundValue
from cosim.scenario.ssp.tree import InnerConnection, Part, SubSystem

Path = tuple[str, ...]
End = tuple[Path, str]
"""Path of a component or system, and a connector of it."""


@dataclass(frozen=True)
class FlatWire:
    """An output, the input that it reaches, and the link in between.

    `converts` : whether values are to be converted where units differ.
    """

    source: End
    target: End
    link: str | None
    line: int
    converts: bool


@dataclass(frozen=True)
class FlatSystem:
    """A system without systems in it.

    Attributes
    ----------
    parts : by path; their values are those of all enclosing systems too.
    """

    parts: dict[Path, Part]
    wires: list[FlatWire]


def flatten(archive: Archive, system: SubSystem) -> FlatSystem:
    """All components of a system and of the systems in it, connected to each other.

    Raises
    ------
    InputError : a connection that leads nowhere or in a circle, or an input with two sources.
    """
    parts = dict(_parts(system, (), ()))
    systems = dict(_systems(system, ()))
    into: dict[End, tuple[End, InnerConnection]] = {}
    for path, one in systems.items():
        for inner_connection in one.inner_connections:
            source, target = (
                _end(path, inner_connection.source),
                _end(path, inner_connection.target),
            )
            for end in (source, target):
                if end[0] not in parts and end[0] not in systems:
                    raise archive.wrong(
                        "a connection of an element that is not there",
                        f"{SSD}:{inner_connection.line}",
                        expected=", ".join(sorted(_names(one))),
                        got=".".join((*end[0], end[1])),
                    )
            if target in into:
                raise archive.wrong(
                    "an input has two sources",
                    f"{SSD}:{inner_connection.line}",
                    got=".".join((*target[0], target[1])),
                )
            into[target] = source, inner_connection
    wires = []
    for target, (source, inner_connection) in into.items():
        if target[0] in parts:
            found = _origin(archive, source, into, systems, inner_connection.link)
            if found is None:
                archive.notes.append(
                    f"{'.'.join((*target[0], target[1]))} comes from outside of the system or "
                    "from nothing: it keeps its start value"
                )
            else:
                wires.append(
                    FlatWire(
                        found[0], target, found[1], inner_connection.line, inner_connection.converts
                    )
                )
    return FlatSystem(parts, wires)


def _names(system: SubSystem) -> list[str]:
    return [part.name for part in system.parts] + [inner.name for inner in system.systems]


def _parts(
    system: SubSystem, path: Path, outer: tuple[BoundValue, ...]
) -> Iterator[tuple[Path, Part]]:
    """Components; a value bound outside wins over one bound inside."""
    bound = (*system.bound, *outer)
    for part in system.parts:
        here = (*path, part.name)
        yield here, replace(part, bound=[*part.bound, *_below(part.name, bound)])
    for inner in system.systems:
        yield from _parts(inner, (*path, inner.name), tuple(_below(inner.name, bound)))


def _below(name: str, bound: tuple[BoundValue, ...]) -> list[BoundValue]:
    start = name + "."
    return [replace(b, name=b.name[len(start) :]) for b in bound if b.name.startswith(start)]


def _systems(system: SubSystem, path: Path) -> Iterator[tuple[Path, SubSystem]]:
    yield path, system
    for inner in system.systems:
        yield from _systems(inner, (*path, inner.name))


def _end(path: Path, end: tuple[str | None, str]) -> End:
    return (path, end[1]) if end[0] is None else ((*path, end[0]), end[1])


def _origin(
    archive: Archive,
    source: End,
    into: dict[End, tuple[End, InnerConnection]],
    systems: dict[Path, SubSystem],
    link: str | None,
) -> tuple[End, str | None] | None:
    """The component's output behind a connector of a system; None if there is none."""
    seen = {source}
    while source[0] in systems:
        before = into.get(source)
        if before is None:
            return None
        source, inner_connection = before
        if link is not None and inner_connection.link is not None:
            raise archive.wrong(
                "a signal passes two links",
                f"{SSD}:{inner_connection.line}",
                got=f"{link}, {inner_connection.link}",
            )
        link = link or inner_connection.link
        if source in seen:
            raise archive.wrong(
                "connections in a circle without a component",
                f"{SSD}:{inner_connection.line}",
                got=".".join((*source[0], source[1])),
            )
        seen.add(source)
    return source, link


def scenario_names(paths: list[Path]) -> dict[Path, str]:
    """A name for each path that a scenario takes, each another."""
    names: dict[Path, str] = {}
    for path in paths:
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", "_".join(path)).strip("_")
        name = name if re.match(r"[A-Za-z]", name) else f"c_{name}"
        number, free = 2, name
        while free in names.values():
            free, number = f"{name}_{number}", number + 1
        names[path] = free
    return names
