"""Check what variables say of each other: aliases, arrays, derivatives, previous values, clocks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping

from cosim.fmu.inspect.declared_model import XML, DeclaredModel, DeclaredVariable, integer, number
from cosim.fmu.inspect.findings import Finding, finding

_SETTABLE = ("input", "parameter", "structuralParameter")
_TIMED = ("constant", "fixed", "tunable")
_PERIODIC = ("intervalDecimal", "shiftDecimal", "resolution", "intervalCounter", "shiftCounter")


def reference_findings(model: DeclaredModel) -> Iterator[Finding]:
    """Check value references and the references of variables to variables."""
    yield from _shared_references(model)
    if model.major == 1:
        return
    by_target = model.variables_by_target()
    previous = defaultdict(list)
    for v in model.variables:
        yield from _derivative(v, model, by_target)
        if model.major == 3:
            yield from _array(v, by_target)
            yield from _clocked(v, by_target)
            if v.type == "Clock":
                yield from _clock(v, model)
            if v.previous is not None:
                previous[v.previous].append(v)
                yield from _previous(v, by_target)
    for reference, sharing in previous.items():
        if len(sharing) > 1:
            names = ", ".join(v.name for v in sharing)
            what = f"previous={reference} is shared by {names}"
            yield finding("previous", sharing[1].where, what)


def _shared_references(model: DeclaredModel) -> Iterator[Finding]:
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


def _alias_set(aliases: list[DeclaredVariable]) -> Iterator[Finding]:
    where, names = aliases[1].where, ", ".join(v.name for v in aliases[:5])
    units = sorted({v.unit if v.unit is not None else "none" for v in aliases})
    if len(units) > 1 and aliases[0].type == "Real":
        yield finding("alias-unit", where, f"{names} have units {', '.join(units)}")
    constant = [v for v in aliases if v.variability == "constant"]
    if constant and len(constant) < len(aliases):
        yield finding("alias-constant", where, f"of {names} only {constant[0].name} is constant")
    started = [v for v in aliases if v.start is not None]
    starts = {v.start for v in started}
    if len({number(s) if number(s) is not None else s for s in starts}) > 1:
        texts = ", ".join(sorted(str(start) for start in starts))
        yield finding("alias-start", where, f"{names} start at {texts}")
    elif len(started) > 1 and not constant:
        what = f"{', '.join(v.name for v in started[:5])} all have a start"
        yield finding("alias-start", where, what)
    settable = [v.name for v in aliases if v.causality in _SETTABLE]
    if len(settable) > 1:
        yield finding("alias-settable", where, f"{', '.join(settable)} can all be set")
    elif settable and any(v.causality == "independent" for v in aliases):
        yield finding("alias-settable", where, f"{settable[0]} is an alias of the time")


def _array(v: DeclaredVariable, by_target: Mapping[int, DeclaredVariable]) -> Iterator[Finding]:
    length: int | None = 1
    if v.dimensions and v.causality == "structuralParameter":
        yield finding("dimension", v.where, "a structural parameter is an array")
    for size, reference in v.dimensions:
        if (size is None) == (reference is None):
            what = "no size" if size is None else "a size and a value reference"
            yield finding("dimension", v.where, f"a dimension has {what}")
            length = None
            continue
        extent = size
        if reference is not None:
            given = by_target.get(reference)
            extent = None if given is None else integer(given.start)
            if given is None or not _is_size(given):
                what = f"dimension {reference} is no UInt64 that is constant or structural"
                yield finding("dimension", v.where, what)
                extent = None
        if extent == 0:
            yield finding("dimension", v.where, "a dimension is 0 at the start")
        length = None if length is None or extent is None else length * extent
    if length and v.starts is not None and len(v.starts) not in (1, length):
        elements = f"{length} elements" if v.dimensions else "a scalar"
        yield finding("start-length", v.where, f"{len(v.starts)} starts for {elements}")


def _is_size(v: DeclaredVariable) -> bool:
    """Whether the standard lets a variable give the size of a dimension."""
    return v.type == "UInt64" and (
        v.causality == "structuralParameter" or v.variability == "constant"
    )


def _derivative(
    v: DeclaredVariable, model: DeclaredModel, by_target: Mapping[int, DeclaredVariable]
) -> Iterator[Finding]:
    if v.derivative is None:
        return
    state = by_target.get(v.derivative)
    if state is None:
        yield finding("derivative", v.where, f"derivative={v.derivative} is not a variable")
    elif state is v:
        yield finding("derivative", v.where, "it is declared the derivative of itself")
    elif not state.real:
        yield finding("derivative", v.where, f"its state {state.name} is of type {state.type}")
    elif state.dimensions != v.dimensions:
        yield finding("derivative", v.where, f"its state {state.name} has other dimensions")
    elif v.derivative in model.states:
        wrong = []
        if state.causality not in ("local", "output"):
            wrong.append(f"causality {state.causality}")
        if state.variability != "continuous":
            wrong.append(f"variability {state.variability}")
        if wrong:
            what = f"the continuous-time state {state.name} is of {' and '.join(wrong)}"
            yield finding("state", v.where, what)


def _previous(v: DeclaredVariable, by_target: Mapping[int, DeclaredVariable]) -> Iterator[Finding]:
    before = by_target.get(v.previous or 0)
    if before is None:
        yield finding("previous", v.where, f"previous={v.previous} is not a variable")
        return
    wrong = {
        "it is its own previous value": before is v,
        "it is not clocked": not v.clocks,
        "a clock has no previous value": v.type == "Clock",
        f"it is {v.variability}, not discrete": v.variability != "discrete",
        f"it is of type {v.type}, {before.name} of type {before.type}": before.type != v.type,
        f"{before.name} is {before.variability}, not discrete": before.variability != "discrete",
        f"{before.name} is an input": before.causality == "input",
        f"{before.name} has other dimensions": before.dimensions != v.dimensions,
    }
    for what, found in wrong.items():
        if found:
            yield finding("previous", v.where, what)


def _clocked(v: DeclaredVariable, by_target: Mapping[int, DeclaredVariable]) -> Iterator[Finding]:
    if v.clocks is None:
        return
    if not v.clocks:
        yield finding("clock", v.where, "clocks is an empty list")
    for reference in v.clocks:
        clock = by_target.get(reference)
        if clock is None or clock.type != "Clock":
            yield finding("clock", v.where, f"value reference {reference} is not a clock")
        elif clock is v:
            yield finding("clock", v.where, "a clock is clocked by itself")
    if v.variability not in ("discrete", "tunable"):
        yield finding("clock", v.where, f"a clocked variable is {v.variability}")


def _clock(v: DeclaredVariable, model: DeclaredModel) -> Iterator[Finding]:
    """Check the attributes of a clock, which it may have from its type."""
    declared = model.types_by_name.get(v.declared_type or "")
    given = {**(declared.attributes if declared is not None else {}), **v.attributes}
    kind = given.get("intervalVariability", "")
    if v.causality not in ("input", "output", "local"):
        yield finding("clock-kind", v.where, f"a clock of causality {v.causality}")
    elif v.causality != "input" and kind != "triggered":
        yield finding("clock-kind", v.where, f"an {v.causality} clock is {kind}, not triggered")
    if v.variability != "discrete":
        yield finding("clock-kind", v.where, f"a clock of variability {v.variability}")
    if v.causality == "output" and "priority" in v.attributes:
        yield finding("clock-priority", v.where, "an output clock has a priority")
    needs_priority = v.causality == "input" and "scheduled execution" in model.kinds
    if needs_priority and "priority" not in given:
        yield finding("clock-priority", v.where, "scheduled execution needs its priority")
    yield from _interval(v, kind, given)


def _interval(v: DeclaredVariable, kind: str, given: Mapping[str, str]) -> Iterator[Finding]:
    fraction = given.get("supportsFraction") in ("true", "1")
    interval, counter = number(given.get("intervalDecimal")), number(given.get("intervalCounter"))
    resolution, shift = number(given.get("resolution")), number(given.get("shiftDecimal"))
    wrong = {}
    if kind in _TIMED:
        wrong = {
            # a fixed or tunable one may give it in the initialisation (2.2.8.3)
            "a constant clock without intervalDecimal": interval is None and kind == "constant",
            f"intervalDecimal is {interval}": interval is not None
            and not 0 < interval < float("inf"),
            f"shiftDecimal is {shift}": shift is not None and not 0 <= shift < float("inf"),
            "intervalCounter is 0": counter == 0,
            "resolution is 0": resolution == 0,
            "shiftDecimal without intervalDecimal": shift is not None and interval is None,
            "intervalCounter without supportsFraction": counter is not None and not fraction,
            "intervalCounter without resolution": counter is not None and resolution is None,
            "shiftCounter without intervalCounter": "shiftCounter" in given and counter is None,
        }
    elif kind:
        wrong = {
            f"{name} at a {kind} clock, which is not periodic": name in given for name in _PERIODIC
        }
    for what, found in wrong.items():
        if found:
            yield finding("clock-interval", v.where, what)
    if (
        interval
        and counter
        and resolution
        and abs(counter / resolution - interval) > 1e-6 * interval
    ):
        what = (
            f"intervalDecimal is {interval:g}, intervalCounter/resolution {counter / resolution:g}"
        )
        yield finding("clock-contradiction", v.where, what)
