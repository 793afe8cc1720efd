"""Which variables a connection or a target of a scenario means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from cosim.errors import InputError
from cosim.fmu import FmuDescription
from cosim.master import Connection, Endpoint


def endpoint(text: str) -> Endpoint:
    """`component.variable`, or `component.group`."""
    component, _, variable = text.partition(".")
    return Endpoint(component, variable)


def members(
    fmu: FmuDescription, name: str, causality: Literal["output", "input"]
) -> dict[str, str]:
    """Ending -> variable: "" for the variable itself, ".x" or "[1]" for members of a group."""
    found = {}
    for port in fmu.ports.values():
        ending = port.name[len(name) :]
        if (
            port.causality == causality
            and port.name.startswith(name)
            and ending[:1] in ("", ".", "[")
        ):
            found[ending] = port.name
    return found


def matched(
    fmus: Mapping[str, FmuDescription],
    source: Endpoint,
    target: Endpoint,
    link: str | None,
    number: int,
) -> list[Connection]:
    """One connection per variable: the names themselves, or two groups with equal endings.

    Raises
    ------
    InputError : components, variables or members that do not exist; `number` stands in it.
    """
    where = f"connections[{number}], {source} -> {target}"
    for end in (source, target):
        if end.component not in fmus:
            raise InputError.unknown("component", end.component, fmus, where=where)
    sources = members(fmus[source.component], source.variable, "output")
    targets = members(fmus[target.component], target.variable, "input")
    if "" in sources and "" in targets:
        return [Connection(source, target, link)]
    common = [ending for ending in sources if ending in targets and ending]
    if not common:
        for end, kind, found in ((source, "output", sources), (target, "input", targets)):
            if not found:
                ports = [p.name for p in fmus[end.component].ports.values() if p.causality == kind]
                raise InputError.unknown(
                    kind, end.variable, ports, where=f"{where}: component {end.component!r}"
                )
    if not common or set(sources) != set(targets):
        raise InputError(
            "the two groups do not have the same members",
            where=where,
            expected=f"{source}: {', '.join(sources) or 'none'}",
            got=f"{target}: {', '.join(targets) or 'none'}",
            hint="connect the variables one by one",
        )
    return [
        Connection(
            Endpoint(source.component, source.variable + ending),
            Endpoint(target.component, target.variable + ending),
            link,
        )
        for ending in common
    ]
