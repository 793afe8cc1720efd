"""Flatten nested systems: components by path, connections from output to input."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Set as AbstractSet
from dataclasses import dataclass, replace

from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.names import SSD
from cosim.scenario.ssp.ssp_parameters import BoundValue
from cosim.scenario.ssp.tree import InnerConnection, Part, SubSystem

Path = tuple[str, ...]
End = tuple[Path, str]
"""Path of a component or system, and a connector of it."""

_NO_NAME = "\0"
"""Begins the path of a signal dictionary, whose signals are the same in all systems."""


def end_text(end: End) -> str:
    """Format an end as `system.component.connector`."""
    return ".".join((*end[0], end[1])).removeprefix(_NO_NAME)


@dataclass(frozen=True)
class FlatWire:
    """A connection from an output to an input, over a link or None.

    `converts` : whether values are to be converted if units differ.
    `linear` : factor and offset of what is made of the value.
    """

    source: End
    target: End
    link: str | None
    line: int
    converts: bool
    linear: tuple[float, float] = (1.0, 0.0)


@dataclass(frozen=True)
class FlatSystem:
    """A system without nested systems.

    Attributes
    ----------
    parts : by path, with the values that enclosing systems bind to them.
    """

    parts: dict[Path, Part]
    wires: list[FlatWire]


def flatten(archive: Archive, system: SubSystem) -> FlatSystem:
    """Collect the components of all nested systems and connect them directly.

    Raises
    ------
    InputError : a connection that leads nowhere or in a circle, or an input with two sources.
    """
    parts = dict(_parts(system, (), ()))
    systems = dict(_systems(system, ()))
    dictionaries = {
        (_NO_NAME + name,) for one in systems.values() for name in one.dictionaries.values()
    }
    into: dict[End, tuple[End, InnerConnection]] = {}
    for path, one in systems.items():
        for inner_connection in one.inner_connections:
            where = f"{SSD}:{inner_connection.line}"
            source = _end(path, inner_connection.source, one)
            target = _end(path, inner_connection.target, one)
            for end in (source, target):
                if end[0] not in parts and end[0] not in systems and end[0] not in dictionaries:
                    names = [p.name for p in one.parts] + [s.name for s in one.systems]
                    names += one.dictionaries
                    raise archive.wrong(
                        "a connection of an unknown element",
                        where,
                        expected=", ".join(sorted(names)),
                        got=end_text(end),
                    )
            if target in into:
                raise archive.wrong("an input has two sources", where, got=end_text(target))
            into[target] = source, inner_connection
    wires = []
    for target, (source, inner_connection) in into.items():
        if target[0] in parts:
            passing = systems.keys() | dictionaries
            found = _origin(archive, source, into, passing, inner_connection)
            if found is None:
                archive.notes.append(
                    f"{end_text(target)} comes from outside of the system or from nothing: it "
                    "keeps its start value"
                )
            else:
                line, converts = inner_connection.line, inner_connection.converts
                wires.append(FlatWire(found[0], target, found[1], line, converts, found[2]))
    return FlatSystem(parts, wires)


def _parts(
    system: SubSystem, path: Path, outer: tuple[BoundValue, ...]
) -> Iterator[tuple[Path, Part]]:
    """Yield all components; a value bound outside overrides one bound inside."""
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


def _end(path: Path, end: tuple[str | None, str], system: SubSystem) -> End:
    element, connector = end
    if element is None:
        return path, connector
    if element in system.dictionaries:
        return (_NO_NAME + system.dictionaries[element],), connector
    return (*path, element), connector


def _origin(
    archive: Archive,
    source: End,
    into: dict[End, tuple[End, InnerConnection]],
    passing: AbstractSet[Path],
    last: InnerConnection,
) -> tuple[End, str | None, tuple[float, float]] | None:
    """Return the output behind the connector `source`, link, and factor and offset; None: none.

    `passing` : systems and signal dictionaries, whose connectors only pass values on.
    """
    seen = {source}
    link, linear = last.link, last.linear
    while source[0] in passing:
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
        linear = followed(inner_connection.linear, linear)
        if source in seen:
            raise archive.wrong(
                "connections in a circle without a component",
                f"{SSD}:{inner_connection.line}",
                got=end_text(source),
            )
        seen.add(source)
    return source, link, linear


def followed(first: tuple[float, float], then: tuple[float, float]) -> tuple[float, float]:
    """Return factor and offset of two linear maps, one after the other."""
    return then[0] * first[0], then[0] * first[1] + then[1]


def scenario_names(paths: list[Path], known: Mapping[str, str]) -> dict[Path, str]:
    """Return a distinct name for each path, valid in a scenario.

    `known` : element of the outermost system -> its name, from an archive of this project.
    """
    names: dict[Path, str] = {}
    for path in paths:
        joined = known.get(path[0], path[0]) if len(path) == 1 else "_".join(path)
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", str(joined)).strip("_")
        name = name if re.match(r"[A-Za-z]", name) else f"c_{name}"
        number, free = 2, name
        while free in names.values():
            free, number = f"{name}_{number}", number + 1
        names[path] = free
    return names
