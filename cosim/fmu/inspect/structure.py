"""Check the references, lists and dependencies of ModelStructure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from cosim.fmu.inspect.declared_model import XML, DeclaredModel, DeclaredVariable, Unknown
from cosim.fmu.inspect.findings import Finding, finding, first_few

_KNOWNS = ("input", "independent")
_SETTABLE = ("parameter", "structuralParameter", "calculatedParameter")
_LATE = ("fixed", "tunable", "discrete")


def structure_findings(model: DeclaredModel) -> Iterator[Finding]:
    """Check each entry, the dependencies, and that the lists are complete."""
    if model.major == 1:
        return
    by_target = model.variables_by_target()
    states = {v.derivative for v in model.variables if v.derivative is not None}
    states |= {v.previous for v in model.variables if v.previous is not None}
    states |= {u.target for u in model.structure if u.role == "clocked state" and u.target}
    has_inputs = any(v.causality == "input" for v in model.variables)
    open_outputs = []
    for unknown in model.structure:
        where = f"{XML}:{unknown.line} {unknown.role}"
        target = by_target.get(unknown.target) if unknown.target is not None else None
        if target is None:
            what = f"it points to {unknown.target}, and there is no such variable"
            yield finding("structure-dangling", where, what)
        else:
            where = f"{where} {target.name}"
            yield from _entry(unknown, target, where)
            if unknown.role == "output" and unknown.dependencies is None and has_inputs:
                open_outputs.append(target.name)
        yield from _kinds(unknown, target, where)
        yield from _dependencies(unknown, where, by_target, states)
        numbers = list(unknown.dependencies or ())
        if model.major == 2 and numbers != sorted(set(numbers)):
            text = " ".join(map(str, numbers[:10]))
            yield finding("dependency-order", where, f"dependencies are {text}")
    for (role, number), times in Counter((u.role, u.target) for u in model.structure).items():
        if times > 1:
            yield finding("structure-twice", XML, f"{role} {number} is listed {times} times")
    yield from _complete(model)
    yield from _initial_unknowns(model, by_target)
    if open_outputs:
        what = f"{len(open_outputs)} outputs do not declare dependencies: {first_few(open_outputs)}"
        yield finding("dependency-open", XML, what)


def _entry(unknown: Unknown, target: DeclaredVariable, where: str) -> Iterator[Finding]:
    """Check that a variable is what the list is for."""
    wrong: dict[str, bool] = {}
    code = f"structure-{unknown.role}s".replace(" ", "-")
    if unknown.role == "output":
        wrong = {f"{target.name} is of causality {target.causality}": target.causality != "output"}
    elif unknown.role == "derivative":
        code = "structure-derivative"
        wrong = {
            f"{target.name} has no attribute derivative": target.derivative is None,
            f"{target.name} is of type {target.type}": not target.real,
            f"{target.name} is {target.variability}": target.variability != "continuous",
        }
    elif unknown.role == "clocked state":
        wrong = {
            f"{target.name} has no attribute previous": target.previous is None,
            f"{target.name} has no attribute clocks": not target.clocks,
            f"{target.name} is a clock": target.type == "Clock",
            f"{target.name} is {target.variability}": target.variability != "discrete",
        }
    elif unknown.role == "event indicator":
        wrong = {
            f"{target.name} is of type {target.type}": not target.real,
            f"{target.name} is {target.variability}": target.variability != "continuous",
            f"{target.name} is of causality {target.causality}": target.causality
            not in ("local", "output"),
        }
    for what, found in wrong.items():
        if found:
            yield finding(code, where, what)


def _complete(model: DeclaredModel) -> Iterator[Finding]:
    """Check that every output and every clocked state is listed."""
    outputs, clocked = (
        {u.target for u in model.structure if u.role == role}
        for role in ("output", "clocked state")
    )
    for v in model.variables:
        target = _target(v, model)
        if v.causality == "output" and target not in outputs:
            yield finding("structure-outputs", v.where, f"output {v.name} is not in ModelStructure")
        if v.previous is not None and target not in clocked:
            what = f"{v.name} has a previous value, and is not in ModelStructure"
            yield finding("structure-clocked-states", v.where, what)


def _initial_unknowns(
    model: DeclaredModel, by_target: Mapping[int, DeclaredVariable]
) -> Iterator[Finding]:
    """Compare InitialUnknowns with the variables that the standard asks for."""
    listed = [u.target for u in model.structure if u.role == "initial" and u.target is not None]
    derivatives = {u.target for u in model.structure if u.role == "derivative"}
    states, known = model.states, {*listed}
    for v in model.variables:
        target = _target(v, model)
        unknown = (
            v.initial in ("approx", "calculated")
            and v.type != "Clock"
            and (
                (v.causality == "output" and not v.clocks)
                or target in derivatives
                or target in states
            )
        )
        unknown = unknown or v.causality == "calculatedParameter"
        if unknown and target not in known:
            what = f"{v.name} is computed at the start, and is not listed"
            yield finding("structure-initial", v.where, what)
        elif target in known and not unknown and not v.clocks and v.type != "Clock":
            what = f"{v.name} is listed: {v.causality}, initial {v.initial}"
            yield finding("structure-initial", v.where, what)
    existing = [number for number in listed if number in by_target]
    if model.major == 2 and existing != sorted(existing):
        what = "InitialUnknowns are not in the order of their indices"
        yield finding("structure-order", XML, what)


def _target(v: DeclaredVariable, model: DeclaredModel) -> int | None:
    return v.index if model.major == 2 else v.reference


def _kinds(unknown: Unknown, target: DeclaredVariable | None, where: str) -> Iterator[Finding]:
    given, kinds = unknown.dependencies, unknown.kinds
    if kinds is None:
        return
    if given is None or len(kinds) != len(given):
        counted = "no dependencies" if given is None else f"{len(given)} dependencies"
        yield finding("dependency-kind", where, f"{len(kinds)} kinds for {counted}")
    late = sorted({kind for kind in kinds if kind in _LATE})
    if target is not None and not target.real and (late or "constant" in kinds):
        # the Reference-FMUs write constant for variables of every type
        code = "dependency-kind" if late else "dependency-factor"
        factor = late[0] if late else "constant"
        yield finding(code, where, f"kind {factor} for a variable of type {target.type}")
    elif unknown.role == "initial" and late:
        yield finding("dependency-kind", where, f"kind {late[0]} at the start")


def _dependencies(
    unknown: Unknown, where: str, by_target: Mapping[int, DeclaredVariable], states: set[int]
) -> Iterator[Finding]:
    for number in unknown.dependencies or ():
        known = by_target.get(number)
        if known is None:
            yield finding("dependency-dangling", where, f"dependency {number} is not a variable")
        elif known.causality not in _KNOWNS and number not in states and not known.clocks:
            at_start = unknown.role == "initial" and known.initial == "exact"
            parameter = known.causality in _SETTABLE or known.type == "Clock"
            if not at_start and not parameter and unknown.role != "event indicator":
                what = f"{known.name} is of causality {known.causality}"
                yield finding("dependency-known", where, what)
