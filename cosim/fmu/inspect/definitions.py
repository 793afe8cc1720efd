"""Check what stands beside the variables: kinds of use, units, types, categories, experiment."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from cosim.fmu.inspect.declared_model import (
    XML,
    DeclaredModel,
    DeclaredType,
    Interface,
    number,
)
from cosim.fmu.inspect.findings import Finding, finding

_C_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NEEDS = {
    "canSerializeFMUstate": "canGetAndSetFMUstate",
    "canSerializeFMUState": "canGetAndSetFMUState",
    "canReturnEarlyAfterIntermediateUpdate": "providesIntermediateUpdate",
}


def definition_findings(model: DeclaredModel) -> Iterator[Finding]:
    """Check the description except variables, ModelStructure and the files."""
    yield from _interfaces(model)
    if not (model.token or "").strip():
        yield finding("token-empty", XML, "guid or instantiationToken is empty or missing")
    if model.major > 1:
        yield from _units(model)
    yield from _types(model)
    for tag, names in model.named.items():
        yield from _unique(tag, [(XML, name) for name in names], "listed-twice")
    yield from _experiment(model)


def identifier_findings(identifier: str, kind: str) -> Iterator[Finding]:
    """Check that it names a binary inside the FMU."""
    if not _C_NAME.fullmatch(identifier):
        yield finding("identifier", f"{XML} {kind}", f"modelIdentifier is {identifier!r}")


def _interfaces(model: DeclaredModel) -> Iterator[Finding]:
    if not model.interfaces:
        yield finding("kind-none", XML, "there is no CoSimulation, no ModelExchange")
    for kind, times in Counter(interface.kind for interface in model.interfaces).items():
        if times > 1:
            yield finding("kind-twice", XML, f"{times} elements declare {kind}")
    for interface in model.interfaces:
        yield from identifier_findings(interface.identifier, interface.kind)
        yield from _capabilities(interface)
    clocked = any(v.type == "Clock" for v in model.variables)
    for interface in model.interfaces:
        if clocked and interface.kind == "co-simulation" and not interface.is_true("hasEventMode"):
            what = "it has clocks, and hasEventMode is not true"
            yield finding("clock-event-mode", f"{XML} {interface.kind}", what)


def _capabilities(interface: Interface) -> Iterator[Finding]:
    where = f"{XML} {interface.kind}"
    for flag, needed in _NEEDS.items():
        if interface.is_true(flag) and not interface.is_true(needed):
            yield finding("capability", where, f"{flag} is true, {needed} is not")
    step = number(interface.attributes.get("fixedInternalStepSize"))
    if step is not None and not 0.0 < step < math.inf:
        yield finding("experiment", where, f"fixedInternalStepSize is {step:g}")


def _unique(what: str, names: Iterable[tuple[str, str]], code: str) -> Iterator[Finding]:
    """Find names that are empty or listed twice; `names` are pairs of place and name."""
    listed = list(names)
    counts = Counter(name for _, name in listed)
    for where, name in dict.fromkeys(listed):
        if not name:
            yield finding("name-empty", where, f"{what} without a name")
        elif counts[name] > 1:
            yield finding(code, where, f"{what} {name!r} is defined {counts[name]} times")


def _units(model: DeclaredModel) -> Iterator[Finding]:
    names = Counter(unit.name for unit in model.units)
    for name, times in names.items():
        if times > 1:
            yield finding("unit-twice", XML, f"unit {name!r} is defined {times} times")
        if not name and model.major == 3:
            yield finding("name-empty", XML, "a unit without a name")
    for unit in model.units:
        displays = [(unit.where, display.get("name", "")) for display in unit.displays]
        yield from _unique("display unit", displays, "unit-twice")
        for display in unit.displays:
            yield from _conversion(unit.where, f"display unit {display.get('name')!r}", display)
            inverse = display.get("inverse") in ("true", "1")
            if inverse and number(display.get("offset", "0")) != 0.0:
                what = f"display unit {display.get('name')!r} is inverse and has an offset"
                yield finding("unit-inverse", unit.where, what)
        if unit.base is None:
            yield finding("unit-open", unit.where, "the unit has no base exponents")
        else:
            yield from _conversion(unit.where, "the unit", unit.base)


def _conversion(where: str, what: str, attributes: Mapping[str, str]) -> Iterator[Finding]:
    """Check that a factor and an offset convert values there and back."""
    factor = number(attributes.get("factor", "1"))
    offset = number(attributes.get("offset", "0"))
    if factor is not None and (factor == 0.0 or not math.isfinite(factor)):
        yield finding("unit-factor", where, f"{what} has the factor {factor:g}")
    if offset is not None and not math.isfinite(offset):
        yield finding("unit-factor", where, f"{what} has the offset {offset:g}")


def _types(model: DeclaredModel) -> Iterator[Finding]:
    yield from _unique("type", [(t.where, t.name) for t in model.types], "listed-twice")
    variables = {v.name for v in model.variables}
    units = {unit.name: {d.get("name") for d in unit.displays} for unit in model.units}
    for each in model.types:
        if each.name in variables and model.major > 1:
            yield finding("type-name", each.where, f"a variable is named {each.name!r} as well")
        items = [(each.where, name) for name, _ in each.items]
        yield from _unique("item", items, "item-twice")
        values = [(each.where, value) for _, value in each.items]
        yield from _unique("item value", values, "item-twice")
        low, high = (number(each.attributes.get(key)) for key in ("min", "max"))
        if low is not None and high is not None and low > high:
            yield finding("range-empty", each.where, f"min {low:g} is greater than max {high:g}")
        nominal = number(each.attributes.get("nominal"))
        if nominal is not None and not 0.0 < nominal < math.inf:
            yield finding("nominal", each.where, f"nominal is {nominal:g}")
        if model.major > 1:
            yield from _type_unit(each, units, model.major)


def _type_unit(
    each: DeclaredType, units: Mapping[str, set[str | None]], major: int
) -> Iterator[Finding]:
    unit, display = each.attributes.get("unit"), each.attributes.get("displayUnit")
    if unit is not None and unit not in units:
        yield finding("unit-undefined", each.where, f"unit {unit!r} is not defined")
    elif display is not None and unit is None:
        yield finding("unit-display", each.where, f"display unit {display!r} without a unit")
    elif display is not None and unit is not None and display not in units[unit]:
        what = f"display unit {display!r} is not defined in unit {unit!r}"
        yield finding("unit-display", each.where, what, level="warning" if major == 2 else None)


def _experiment(model: DeclaredModel) -> Iterator[Finding]:
    start, stop, step, tolerance = (
        number(model.experiment.get(key))
        for key in ("startTime", "stopTime", "stepSize", "tolerance")
    )
    where = f"{XML} DefaultExperiment"
    if start is not None and stop is not None and stop <= start:
        yield finding("experiment", where, f"stopTime {stop:g} is not after startTime {start:g}")
    for name, value in (("stepSize", step), ("tolerance", tolerance)):
        if value is not None and not 0.0 < value < math.inf:
            yield finding("experiment", where, f"{name} is {value:g}")
