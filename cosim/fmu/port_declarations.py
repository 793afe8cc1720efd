"""Make ports of the variables that a model description declares."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from math import prod

from cosim.fmu.clock import declared_clock
from cosim.fmu.inspect.declared_model import DeclaredModel, DeclaredVariable, integer, usual_initial
from cosim.fmu.port import (
    TYPE_MAPPINGS,
    FmiVersion,
    Port,
    SignalKind,
    checked_shape,
    parse_start,
    parse_value,
)


def declared_ports(model: DeclaredModel, version: FmiVersion) -> dict[str, Port]:
    """Return every variable by name, without `unusable` ones.

    FMI 3's aliases follow as variables of their own.

    Raises
    ------
    ValueError : start values that do not fit, or a reference to a variable that does not exist.
    """
    direct, undeclared = _feedthrough(model)
    by_reference = {v.reference: v for v in reversed(model.variables)}
    items = {t.name: tuple(int(value) for _, value in t.items) for t in model.types}
    ports = {}
    without = unusable(model)
    for variable, name, description in _named(model):
        if name in without:
            continue
        type_mapping = TYPE_MAPPINGS[version][variable.type]
        kind = type_mapping.kind
        shape = checked_shape(name, tuple(_sizes(variable, by_reference)))
        start = variable.starts or ()
        if len(start) > 1 and len(start) != prod(shape):
            raise ValueError(f"{name} has {len(start)} start values for {prod(shape)} elements")
        nominal = variable.nominal if kind == "float" else None
        ports[name] = Port(
            name=name,
            reference=variable.reference or 0,
            causality=variable.causality,
            variability="discrete"
            if kind != "float" and variable.variability == "continuous"
            else variable.variability,
            kind=kind,
            unit=variable.unit or None,
            start=parse_start(kind, start, shape),
            minimum=_bound(kind, variable.minimum),
            maximum=_bound(kind, variable.maximum),
            description=description,
            feedthrough=variable.index in direct,
            getter_type=type_mapping.getter_type,
            c_type=type_mapping.c_type,
            shape=shape,
            dimensions=tuple(
                size if size is not None else _known(by_reference, reference, variable).name
                for size, reference in variable.dimensions
            ),
            initial=variable.initial
            if version == "1.0"
            else variable.attributes.get("initial")
            or usual_initial(variable.causality, variable.variability, ""),
            items=items.get(variable.declared_type or "", ())
            if variable.type == "Enumeration"
            else (),
            nominal=None if nominal is None else float(nominal) or None,
            feedthrough_declared=variable.index not in undeclared,
            clock=declared_clock({**variable.inherited, **variable.attributes}.get)
            if variable.type == "Clock"
            else None,
            clocks=tuple(_known(by_reference, c, variable).name for c in variable.clocks or ()),
            intermediate=variable.is_true("intermediateUpdate"),
        )
    return ports


def unusable(model: DeclaredModel) -> dict[str, str]:
    """Return the variables that cannot be exchanged, and why.

    Local variables that share a name, and FMI 1's negated aliases: the values of these are those of
    another variable times -1.
    """
    places = defaultdict(set)
    for v in model.variables:
        for name in v.names:
            places[name].add((v.type, v.reference))
    found = {
        name: f"{len(cells)} variables have this name"
        for name, cells in places.items()
        if len(cells) > 1
    }
    negated = (v.name for v in model.variables if v.attributes.get("alias") == "negatedAlias")
    return found | dict.fromkeys(negated, "a negated alias of another variable")


def _named(model: DeclaredModel) -> Iterator[tuple[DeclaredVariable, str, str | None]]:
    """Give each variable with its name and description, then each alias."""
    for v in model.variables:
        yield v, v.name, v.attributes.get("description")
    for v in model.variables:
        for name, _, description in v.aliases:
            yield v, name, description or v.attributes.get("description")


def _known(
    variables: dict[int | None, DeclaredVariable], reference: int | None, at: DeclaredVariable
) -> DeclaredVariable:
    """Return the variable that another one refers to."""
    found = variables.get(reference)
    if found is None:
        raise ValueError(f"{at.name} refers to {reference}, and there is no such variable")
    return found


def _sizes(
    variable: DeclaredVariable, variables: dict[int | None, DeclaredVariable]
) -> Iterator[int]:
    """Give the sizes of an array at the start."""
    for size, reference in variable.dimensions:
        extent = size
        if extent is None:
            extent = integer(_known(variables, reference, variable).start)
        if extent is None:
            raise ValueError(f"{variable.name} has a dimension without a size")
        yield extent


def _bound(kind: SignalKind | None, text: str | None) -> float | None:
    """Return the least or greatest value of a number."""
    return None if text is None or kind not in ("float", "int") else parse_value(kind, text)


def _feedthrough(model: DeclaredModel) -> tuple[set[int], set[int]]:
    """Return by index the outputs with direct feedthrough, and those that do not declare it.

    Undeclared dependencies mean all inputs (FMI 2.0.4 2.2.8, FMI 3.0 2.4.8). A time-based Clock is
    an input that depends on nobody: the master lets it tick before values are exchanged.
    """
    by_target = model.variables_by_target()
    declared = {u.target: u.dependencies for u in model.structure if u.role == "output"}
    found, undeclared = set(), set()
    for variable in model.variables:
        if variable.causality == "output":
            target = variable.reference if model.major == 3 else variable.index
            dependencies = declared.get(target)
            given: Iterable[DeclaredVariable | None] = model.variables
            if dependencies is not None:
                given = [by_target.get(number) for number in dependencies]
            if any(v is None for v in given):
                raise ValueError(f"{variable.name} depends on a variable that does not exist")
            if any(v and v.causality == "input" and not _is_time_based(v) for v in given):
                found.add(variable.index)
                if dependencies is None:
                    undeclared.add(variable.index)
    return found, undeclared


def _is_time_based(variable: DeclaredVariable) -> bool:
    """Whether a variable is a Clock that ticks by the time (of FMI 3.0)."""
    kind = variable.attributes.get("intervalVariability")
    return variable.type == "Clock" and kind != "triggered"
