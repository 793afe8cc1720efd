"""Check the variables: names, ranges, starts, references, types, units."""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator

from cosim.fmu.inspect.declared_model import XML, DeclaredModel, Unit, Variable, integer, number
from cosim.fmu.inspect.findings import Finding, finding, first_few
from cosim.fmu.inspect.units import BASES, Si, si_of_name

# FMI 2.0.4 and 3.0.2, 2.2.9 / 2.4.9: the grammar of structured names; linear in its length
_Q = r"'(?:[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
_B = rf"(?:[A-Za-z_][A-Za-z0-9_]*|{_Q})(?:\[[0-9]+(?:,[0-9]+)*\])?"
_IDENTIFIER = rf"{_B}(?:\.{_B})*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")
_C_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_SETTABLE = ("input", "parameter", "structuralParameter")


def model_findings(model: DeclaredModel) -> Iterator[Finding]:
    """Check the description except ModelStructure and the files."""
    for interface in model.interfaces:
        yield from identifier_findings(interface.identifier, interface.kind)
    if not model.interfaces:
        yield finding("kind-none", XML, "there is no CoSimulation, no ModelExchange")
    if not (model.token or "").strip():
        yield finding("token-empty", XML, "guid or instantiationToken is empty or missing")
    yield from _names(model)
    for variable in model.variables:
        yield from _values(variable, model)
        yield from _array(variable, model)
        yield from _derivative(variable, model)
    yield from _references(model)
    yield from _units(model)
    yield from _experiment(model)


def identifier_findings(identifier: str, kind: str) -> Iterator[Finding]:
    """Check that it names a binary inside the FMU."""
    if not _C_NAME.fullmatch(identifier):
        yield finding("identifier", f"{XML} {kind}", f"modelIdentifier is {identifier!r}")


def _names(model: DeclaredModel) -> Iterator[Finding]:
    structured = model.attributes.get("variableNamingConvention") == "structured"
    names = [(v.where, v.name) for v in model.variables]
    names += [(f"{XML} {name}", name) for name in model.aliases]
    counts = Counter(name for _, name in names)
    for where, name in names:
        if counts[name] > 1:
            yield finding("name-twice", where, f"{counts[name]} variables are named {name!r}")
        if any(c in name for c in "\r\n\t"):
            yield finding("name-control", where, f"the name is {name!r}")
        elif structured and not _STRUCTURED.fullmatch(name):
            yield finding("name-structure", where, f"{name!r} is not a structured name")


def _values(v: Variable, model: DeclaredModel) -> Iterator[Finding]:
    low, high, start = number(v.minimum), number(v.maximum), v.start
    if low is not None and high is not None and low > high:
        yield finding("range-empty", v.where, f"min {v.minimum} is greater than max {v.maximum}")
    if number(v.nominal) == 0.0:
        yield finding("nominal", v.where, "nominal is 0")
    if v.declared_type is not None and v.declared_type not in model.types:
        yield finding("type-undefined", v.where, f"type {v.declared_type!r} is not defined")
    if start is None or v.type in ("String", "Binary", "Boolean", "Clock", ""):
        return
    for word in start.split() if v.dimensions else [start]:
        value = number(word)
        if value is None:
            continue  # a finding of the schema
        if not math.isfinite(value):
            yield finding("start-number", v.where, f"start is {word}")
        elif (low is not None and value < low) or (high is not None and value > high):
            bounds = f"[{v.minimum or '-inf'}, {v.maximum or 'inf'}]"
            yield finding("start-range", v.where, f"start {word} is outside {bounds}")
        items = model.types.get(v.declared_type or "", {}).get("items")
        if v.type == "Enumeration" and items and integer(word) not in map(integer, items):
            yield finding("start-item", v.where, f"start {word} is not one of {', '.join(items)}")


def _array(v: Variable, model: DeclaredModel) -> Iterator[Finding]:
    sizes = (
        {w.reference: integer(w.start) for w in model.variables if w.causality in _SETTABLE[2:]}
        if any(reference is not None for _, reference in v.dimensions)
        else {}
    )
    length: int | None = 1
    for size, reference in v.dimensions:
        if reference is not None and reference not in sizes:
            what = f"dimension {reference} is not a structural parameter's value reference"
            yield finding("dimension", v.where, what)
            length = None
            continue
        extent = size if reference is None else sizes[reference]
        length = None if length is None or extent is None else length * extent
    if v.dimensions and length is not None and v.start is not None and v.type != "String":
        given = len(v.start.split())
        if v.type != "Binary" and given not in (1, length):
            yield finding("start-length", v.where, f"{given} starts for {length} elements")


def _derivative(v: Variable, model: DeclaredModel) -> Iterator[Finding]:
    if v.derivative is not None and model.major > 1:
        state = model.variables_by_target().get(v.derivative)
        if state is None:
            yield finding("derivative", v.where, f"derivative={v.derivative} is not a variable")
        elif not state.real:
            yield finding("derivative", v.where, f"its state {state.name} is of type {state.type}")
    if v.clocks:
        clocks = {w.reference for w in model.variables if w.type == "Clock"}
        for reference in v.clocks:
            if reference not in clocks:
                yield finding("clock", v.where, f"value reference {reference} is not a clock")


def _references(model: DeclaredModel) -> Iterator[Finding]:
    by_reference = defaultdict(list)
    for v in model.variables:
        by_reference[v.reference].append(v)
    mixed = []
    for reference, sharing in by_reference.items():
        if len(sharing) == 1:
            continue
        if model.major == 3:
            names = ", ".join(v.name for v in sharing[:5])
            yield finding("reference-twice", sharing[1].where, f"{reference} is shared by {names}")
            continue
        by_type = defaultdict(list)
        for v in sharing:
            by_type["Integer" if v.type == "Enumeration" else v.type].append(v)
        if len(by_type) > 1:
            mixed.append(reference)
        for aliases in by_type.values():
            if len(aliases) > 1 and model.major == 2:
                yield from _alias_set(aliases)
    if mixed:
        what = f"{len(mixed)} value references are shared by variables of different types"
        yield finding("reference-types", XML, what)


def _alias_set(aliases: list[Variable]) -> Iterator[Finding]:
    where, names = aliases[1].where, ", ".join(v.name for v in aliases[:5])
    units = {v.unit for v in aliases if v.unit is not None}
    if len(units) > 1:
        yield finding("alias-unit", where, f"{names} have units {', '.join(sorted(units))}")
    starts = {v.start for v in aliases if v.start is not None}
    if len({number(s) if number(s) is not None else s for s in starts}) > 1:
        yield finding("alias-start", where, f"{names} start at {', '.join(sorted(starts))}")
    settable = [v.name for v in aliases if v.causality in _SETTABLE]
    if len(settable) > 1:
        yield finding("alias-settable", where, f"{', '.join(settable)} can all be set")


def _units(model: DeclaredModel) -> Iterator[Finding]:
    defined = Counter(unit.name for unit in model.units)
    for name, times in defined.items():
        if times > 1:
            yield finding("unit-undefined", XML, f"unit {name!r} is defined {times} times")
    if model.major == 1:
        return  # base units came with FMI 2
    for unit in model.units:
        where = f"{XML}:{unit.line} unit {unit.name}"
        if unit.base is None:
            yield finding("unit-open", where, "the unit has no base exponents")
        else:
            yield from _base(unit, where, si_of_name(unit.name))
    bare = [
        v.name
        for v in model.variables
        if v.real and v.unit is None and v.causality in ("input", "output")
    ]
    if bare:
        what = f"{len(bare)} inputs and outputs have no unit: {first_few(bare)}"
        yield finding("unit-none", XML, what)


def _base(unit: Unit, where: str, meant: Si | None) -> Iterator[Finding]:
    base = unit.base or {}
    if meant is None:
        return
    declared = tuple(integer(base.get(key, "0")) or 0 for key in BASES)
    if declared != meant.exponents:
        defined, named = _power_product(declared), _power_product(meant.exponents)
        yield finding("unit-base", where, f"defined as {defined}, the name says {named}")
        return
    for key, true in (("factor", meant.factor), ("offset", meant.offset)):
        value = number(base.get(key, "1" if key == "factor" else "0"))
        # factors are often rounded, and some tools count revolutions or cycles; a wrong power of
        # ten is off by 10 or more
        if value is not None and not math.isclose(value, true, rel_tol=1e-3, abs_tol=1e-12):
            yield finding("unit-base", where, f"{key} {value:g}, the name says {true:g}")


def _power_product(exponents: tuple[int, ...]) -> str:
    powers = zip(BASES, exponents, strict=True)
    return " ".join(b if e == 1 else f"{b}^{e}" for b, e in powers if e) or "1"


def _experiment(model: DeclaredModel) -> Iterator[Finding]:
    start, stop, step = (
        number(model.experiment.get(key)) for key in ("startTime", "stopTime", "stepSize")
    )
    where = f"{XML} DefaultExperiment"
    if start is not None and stop is not None and stop <= start:
        yield finding("experiment", where, f"stopTime {stop:g} is not after startTime {start:g}")
    if step is not None and not 0.0 < step < math.inf:
        yield finding("experiment", where, f"stepSize is {step:g}")
