"""Check the variables one by one: names, causality, start values, ranges, types, units."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Container, Iterator, Mapping

from cosim.fmu.inspect.declared_model import XML, DeclaredModel, DeclaredVariable, integer, number
from cosim.fmu.inspect.findings import Finding, finding, first_few
from cosim.fmu.inspect.rules import Level

# FMI 2.0.4 and 3.0.2, 2.2.9 / 2.4.7.5.1: the grammar of structured names; linear in its length
_Q = r"'(?:[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
_B = rf"(?:[A-Za-z_][A-Za-z0-9_]*|{_Q})(?:\[[0-9]+(?:,[0-9]+)*\])?"
_IDENTIFIER = rf"{_B}(?:\.{_B})*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")
_EXACT = ("exact",)
_COMPUTED = ("calculated", "approx")
_ANY = ("calculated", "exact", "approx")
_COMBINATIONS = {
    **{
        (causality, variability): initials
        for causality, initials in (
            ("structuralParameter", _EXACT),
            ("parameter", _EXACT),
            ("calculatedParameter", _COMPUTED),
            ("local", _COMPUTED),
        )
        for variability in ("fixed", "tunable")
    },
    **{
        (causality, variability): initials
        for causality, initials in (("input", _EXACT), ("output", _ANY), ("local", _ANY))
        for variability in ("discrete", "continuous")
    },
    ("output", "constant"): _EXACT,
    ("local", "constant"): _EXACT,
    ("independent", "continuous"): (None,),
}
"""(causality, variability) -> what `initial` may be (FMI 2.0.4, 2.2.7; FMI 3.0.2, 2.4.7.5)."""
_UNTYPED_STARTS = ("String", "Binary", "Boolean", "Clock", "")


def variable_findings(model: DeclaredModel) -> Iterator[Finding]:
    """Check every variable by itself, and that names are unique."""
    yield from _names(model)
    units = {unit.name: {display.get("name") for display in unit.displays} for unit in model.units}
    for variable in model.variables:
        if model.major > 1:
            yield from _combination(variable, model)
            yield from _has_start(variable)
        yield from _type(variable, model)
        yield from _range(variable)
        yield from _start(variable, model)
        if model.major > 1:
            yield from _unit(variable, units, model.major)
            yield from _flags(variable, model)
    yield from _independent(model)
    bare = [
        v.name
        for v in model.variables
        if v.real and v.unit is None and v.causality in ("input", "output")
    ]
    if bare and model.major > 1:
        what = f"{len(bare)} inputs and outputs have no unit: {first_few(bare)}"
        yield finding("unit-none", XML, what)


def _names(model: DeclaredModel) -> Iterator[Finding]:
    structured = model.attributes.get("variableNamingConvention") == "structured"
    names = [(v.where, name) for v in model.variables for name in v.names]
    counts = Counter(name for _, name in names)
    used = {name for v in model.variables if v.causality != "local" for name in v.names}
    for where, name in names:
        if not name:
            yield finding("name-empty", where, "the name is empty")
            continue
        if counts[name] > 1:
            what = f"{counts[name]} variables are named {name!r}"
            yield finding("name-twice", where, what, level=None if name in used else "warning")
        if any(c in name for c in "\r\n\t"):
            yield finding("name-control", where, f"the name is {name!r}")
        elif structured and not _STRUCTURED.fullmatch(name):
            yield finding("name-structure", where, f"{name!r} is not a structured name")


def _combination(v: DeclaredVariable, model: DeclaredModel) -> Iterator[Finding]:
    allowed = _COMBINATIONS.get((v.causality, v.variability))
    pair = f"causality {v.causality} and variability {v.variability}"
    written = v.attributes.get("initial")
    if v.variability == "continuous" and not v.real:
        yield finding("not-continuous", v.where, f"a continuous variable of type {v.type}")
        if v.attributes.get("variability") is None and (v.causality, "discrete") in _COMBINATIONS:
            return  # FMI 2's default, which is all that is wrong: discrete is meant
    if allowed is None:
        yield finding("combination", v.where, f"{pair} do not go together")
    elif v.initial not in allowed and v.type != "Clock":
        options = ", ".join(str(each) for each in allowed)
        what = f"initial is {v.initial}; {pair} allow {options}"
        yield finding("combination", v.where, what.replace("allow None", "allow none"))
    elif v.causality == "input" and written is not None and model.major == 2:
        yield finding("initial-input", v.where, f"initial is {written}")


def _type(v: DeclaredVariable, model: DeclaredModel) -> Iterator[Finding]:
    if v.declared_type is None:
        return
    declared = model.types_by_name.get(v.declared_type)
    if declared is None:
        yield finding("type-undefined", v.where, f"type {v.declared_type!r} is not defined")
    elif declared.type.removesuffix("Type") != v.type:
        what = f"type {declared.name!r} is for {declared.type}, the variable is of type {v.type}"
        yield finding("type-kind", v.where, what)


def _range(v: DeclaredVariable) -> Iterator[Finding]:
    low, high = number(v.minimum), number(v.maximum)
    if low is not None and high is not None and low > high:
        yield finding("range-empty", v.where, f"min {v.minimum} is greater than max {v.maximum}")
    nominal = number(v.nominal)
    if nominal is not None and not 0.0 < nominal < math.inf:
        yield finding("nominal", v.where, f"nominal is {nominal:g}")


def _has_start(v: DeclaredVariable) -> Iterator[Finding]:
    if v.type in ("Clock", ""):
        return
    needed = v.initial in ("exact", "approx") and v.causality != "independent"
    if v.starts is None and needed:
        yield finding("start-missing", v.where, f"{v.causality}, initial {v.initial}: no start")
    elif v.starts is not None and v.causality == "independent":
        yield finding("start-superfluous", v.where, "time has a start value")
    elif v.starts is not None and v.initial == "calculated":
        what = f"{v.causality}, initial calculated: it has a start value"
        yield finding("start-superfluous", v.where, what)


def _start(v: DeclaredVariable, model: DeclaredModel) -> Iterator[Finding]:
    if v.starts is None or v.type in _UNTYPED_STARTS:
        return
    low, high = number(v.minimum), number(v.maximum)
    declared = model.types_by_name.get(v.declared_type or "")
    items = [value for _, value in declared.items] if declared is not None else []
    for word in v.starts:
        value = number(word)
        if value is None:
            continue  # a finding of the schema
        if not math.isfinite(value):
            level: Level | None = "error" if model.major == 2 else None
            yield finding("start-number", v.where, f"start is {word}", level=level)
        elif (low is not None and value < low) or (high is not None and value > high):
            bounds = f"[{v.minimum or '-inf'}, {v.maximum or 'inf'}]"
            yield finding("start-range", v.where, f"start {word} is outside {bounds}")
        if v.type == "Enumeration" and items and integer(word) not in map(integer, items):
            yield finding("start-item", v.where, f"start {word} is not one of {', '.join(items)}")


def _unit(
    v: DeclaredVariable, units: Mapping[str, Container[str | None]], major: int
) -> Iterator[Finding]:
    """Check that the unit and display units are defined; FMI 2 ignores undefined display units."""
    if v.unit is not None and v.unit not in units:
        yield finding("unit-undefined", v.where, f"unit {v.unit!r} is not defined")
        return
    for name in (v.display_unit, *(display for _, display, _ in v.aliases)):
        if name is None:
            continue
        if v.unit is None:
            yield finding("unit-display", v.where, f"display unit {name!r} without a unit")
        elif name not in units[v.unit]:
            what = f"display unit {name!r} is not defined in unit {v.unit!r}"
            level: Level | None = "warning" if major == 2 else None
            yield finding("unit-display", v.where, what, level=level)


def _flags(v: DeclaredVariable, model: DeclaredModel) -> Iterator[Finding]:
    """Check attributes that only some variables may have."""
    exchange = "model exchange" in model.kinds
    once = v.attributes.get("canHandleMultipleSetPerTimeInstant")
    if once is not None and v.causality != "input":
        what = f"canHandleMultipleSetPerTimeInstant at a variable of causality {v.causality}"
        yield finding("attribute-place", v.where, what)
    key = v.index if model.major == 2 else v.reference
    reinit = v.attributes.get("reinit")
    if reinit is not None and exchange and key not in model.states:
        yield finding("attribute-place", v.where, "reinit at a variable that is no state")
    if model.major == 2 and model.kinds and not exchange:
        for name, value in (("canHandleMultipleSetPerTimeInstant", once), ("reinit", reinit)):
            if value is not None:
                yield finding("attribute-place", v.where, f"{name} is of model exchange alone")
    if v.is_true("intermediateUpdate") and v.variability != "continuous":
        what = f"intermediateUpdate at a variable of variability {v.variability}"
        yield finding("attribute-place", v.where, what)


def _independent(model: DeclaredModel) -> Iterator[Finding]:
    if model.major == 1:
        return
    found = [v for v in model.variables if v.causality == "independent"]
    if len(found) > 1 or (model.major == 3 and not found):
        names = f": {first_few([v.name for v in found])}" if found else ""
        yield finding("independent", XML, f"{len(found)} independent variables{names}")
    for v in found:
        if not v.real or v.dimensions:
            what = "an array" if v.real else f"of type {v.type}"
            yield finding("independent", v.where, f"the independent variable is {what}")
