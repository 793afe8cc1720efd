"""Resolve the ends of a connection, or a target, to variables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.master import Connection, Endpoint, Policy
from cosim.scenario.terminal_rules import Ends, joined_by_terminals


def endpoint(text: str) -> Endpoint:
    """Split `component.variable`, or `component.group`, at the first dot."""
    component, _, variable = text.partition(".")
    return Endpoint(component, variable)


def members(
    fmu: FmuDescription, name: str, causality: Literal["output", "input"]
) -> dict[str, str]:
    """Return suffix -> variable: "" for the variable itself, ".x" or "[1]" for a member."""
    found = {}
    for port in fmu.ports.values():
        suffix = port.name[len(name) :]
        if (
            port.causality == causality
            and port.name.startswith(name)
            and suffix[:1] in ("", ".", "[")
        ):
            found[suffix] = port.name
    return found


def matched(
    fmus: Mapping[str, FmuDescription],
    source: Endpoint,
    target: Endpoint,
    link: str | None = None,
    policy: Policy = "hold",
    components: Iterable[str] = (),
) -> list[Connection]:
    """Make one connection per variable: of two variables, groups with equal members, or terminals.

    A group of one element meets a variable. A time-based Clock, which the master lets tick, is a
    source: a triggered one may follow it.

    `components` : names of components that exist, even if their FMUs were not found.

    Raises
    ------
    InputError : unknown components, variables or members.
    """
    where = f"{source} -> {target}"
    for end in (source, target):
        if end.component not in fmus:
            if end.component in components:
                return []
            raise InputError.unknown("component", end.component, fmus, where=where)
    port = fmus[source.component].ports.get(source.variable)
    sources = members(fmus[source.component], source.variable, "output")
    targets = members(fmus[target.component], target.variable, "input")
    if "" in targets and port is not None and port.is_source:
        return [Connection(source, target, link, policy)]
    if [*sources, *targets] in (["", "[1]"], ["[1]", ""]):  # a variable, and a group of one
        (mine,), (theirs,) = sources, targets
        ends = (
            Endpoint(source.component, source.variable + mine),
            Endpoint(target.component, target.variable + theirs),
        )
        return [Connection(*ends, link, policy)]
    grouped = [_ends(source, target, suffix) for suffix in sources if suffix in targets and suffix]
    equal = bool(grouped) and set(sources) == set(targets)
    try:
        joined = joined_by_terminals(fmus, source, target)
    except InputError:
        if not all(_is_group(fmus[end.component], end.variable) for end in (source, target)):
            raise
        joined = []  # groups of these names, which may be connected though the terminals are not
    if not equal and not joined:
        raise _no_groups(fmus, source, target, sources, targets)
    found = grouped if set(grouped).issuperset(joined) else joined
    return [Connection(*ends, link, policy) for ends in found]


def _is_group(fmu: FmuDescription, name: str) -> bool:
    return bool(members(fmu, name, "output") or members(fmu, name, "input"))


def _no_groups(
    fmus: Mapping[str, FmuDescription],
    source: Endpoint,
    target: Endpoint,
    sources: Mapping[str, str],
    targets: Mapping[str, str],
) -> InputError:
    """Make the error for ends that are no variables, and no groups with equal members."""
    where = f"{source} -> {target}"
    if not set(sources) & set(targets) - {""}:
        if not sources:
            return _no_member(fmus[source.component], source, "output", where)
        if not targets:
            return _no_member(fmus[target.component], target, "input", where)
    return InputError(
        "the two groups do not have the same members",
        where=where,
        expected=f"{source}: {', '.join(sources) or 'none'}",
        got=f"{target}: {', '.join(targets) or 'none'}",
        hint="connect the variables one by one",
    )


def _ends(source: Endpoint, target: Endpoint, suffix: str) -> Ends:
    return (
        Endpoint(source.component, source.variable + suffix),
        Endpoint(target.component, target.variable + suffix),
    )


_Kind = Literal["output", "input"]


def _no_member(fmu: FmuDescription, end: Endpoint, kind: _Kind, where: str) -> InputError:
    """Make the error for an end that is not an output, or not an input."""
    fmu.require_usable(end.variable, where=where)
    other: _Kind = "input" if kind == "output" else "output"
    if members(fmu, end.variable, other):
        problem = "two outputs cannot be connected" if kind == "input" else "nothing comes from it"
        return InputError(
            f"{end} is an {other}: {problem}",
            where=where,
            expected="an output on the left, an input on the right",
            hint="the ends may be the wrong way round",
        )
    ports = [p.name for p in fmu.ports.values() if p.causality == kind]
    inside = fmu.ports.get(end.variable)
    if inside is not None:
        return InputError(
            f"{end} is neither input nor output",
            where=where,
            expected=f"an {kind} of component {end.component!r}",
            got=f"a {inside.causality}",
        )
    return InputError.unknown(
        kind, end.variable, ports, where=f"{where}: component {end.component!r}"
    )
