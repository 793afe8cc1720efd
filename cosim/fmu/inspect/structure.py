"""Check the references, outputs and dependencies of ModelStructure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cosim.fmu.inspect.declared_model import XML, DeclaredModel, Unknown, Variable
from cosim.fmu.inspect.findings import Finding, finding, first_few

_KNOWNS = ("input", "independent")
_SETTABLE = ("parameter", "structuralParameter", "calculatedParameter")


def structure_findings(model: DeclaredModel) -> Iterator[Finding]:
    """Check references and dependencies, and find missing outputs."""
    if model.major == 1:
        return
    variables_by_target = model.variables_by_target()
    states = {v.derivative for v in model.variables if v.derivative is not None}
    has_inputs = any(v.causality == "input" for v in model.variables)
    open_outputs = []
    for unknown in model.structure:
        where = f"{XML}:{unknown.line} {unknown.role}"
        target = variables_by_target.get(unknown.target) if unknown.target is not None else None
        if target is None:
            what = f"it points to {unknown.target}, and there is no such variable"
            yield finding("structure-dangling", where, what)
        else:
            where = f"{where} {target.name}"
            if unknown.role == "output" and target.causality != "output":
                what = f"{target.name} is of causality {target.causality}"
                yield finding("structure-outputs", where, what)
            if unknown.role == "output" and unknown.dependencies is None and has_inputs:
                open_outputs.append(target.name)
        yield from _dependencies(unknown, where, variables_by_target, states)
    listed = {u.target for u in model.structure if u.role == "output"}
    for v in model.variables:
        key = v.index if model.major == 2 else v.reference
        if v.causality == "output" and key not in listed:
            yield finding("structure-outputs", v.where, f"output {v.name} is not in ModelStructure")
    if open_outputs:
        what = f"{len(open_outputs)} outputs do not declare dependencies: {first_few(open_outputs)}"
        yield finding("dependency-open", XML, what)


def _dependencies(
    unknown: Unknown, where: str, variables_by_target: Mapping[int, Variable], states: set[int]
) -> Iterator[Finding]:
    given, kinds = unknown.dependencies, unknown.kinds
    if kinds is not None and (given is None or len(kinds) != len(given)):
        counted = "no dependencies" if given is None else f"{len(given)} dependencies"
        yield finding("dependency-kind", where, f"{len(kinds)} kinds for {counted}")
    for number in given or ():
        known = variables_by_target.get(number)
        if known is None:
            yield finding("dependency-dangling", where, f"dependency {number} is not a variable")
        elif known.causality not in _KNOWNS and number not in states and not known.clocks:
            at_start = unknown.role == "initial" and known.causality != "output"
            parameter = known.causality in _SETTABLE or known.type == "Clock"
            if not at_start and not parameter:
                what = f"{known.name} is of causality {known.causality}"
                yield finding("dependency-known", where, what)
