"""Systems by name (`paper`, `auv`), or as TOML files with the symbols of Eq. (7).

The keys are those of `cosim.hinf.problem.system_file`. One delay, with the symbols of the paper,
or any number of delays, one table each::

    [system]                            [system]
    A = [[-5.0, 0.0], [6.0, -10.0]]     A = [[0.0, 1.0], [0.0, 0.0]]
    A1 = [[-1.0, 0.0], [2.0, 1.0]]      [[system.delays]]
    d = 0.3                             d = 1.25
                                        feedback = true

Integral action is of `feedback_structure`, weights by frequency are of `filters`, sensors and
observers of `measurements`, what a design must meet of `design_constraints`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cosim.core import (
    SYSTEM_FILE,
    Findings,
    InputError,
    Layer,
    Origin,
    unreadable,
    validated,
)
from cosim.hinf import problem
from cosim.hinf.certificate import counted_as, fitted
from cosim.hinf.problem.design_constraints import KEYS, DesignConstraints, design_constraints_of
from cosim.hinf.problem.measurements import ObserverSettings, measured
from cosim.hinf.problem.system_file import FilterPart, SystemFile, SystemTable
from cosim.models import (
    Delay as Delay,  # noqa: PLC0414 - the face of this package offers it
    DelaySystem as DelaySystem,  # noqa: PLC0414 - the same
    paper_example,
)

BUILT_IN_SYSTEMS = ("paper", "auv")
"""Names of the systems that need no file."""

_OTHER_FILES = {
    ".json": "a design has its system inside: cosim certificate check {file} shows and proves "
    "it, cosim fmu controller {file} makes its FMU",
    ".mat": "matrices are written into a TOML file, or given from Python: cosim.DelaySystem",
    ".fmu": "of an FMU no system can be read: its matrices are written into a TOML file",
}
"""Files that are no systems, and what to do with them."""


@dataclass(frozen=True)
class NamedSystem:
    """A system with the settings of its design.

    k1, k2 : one number per delay, k2 not zero; None: to be searched.
    gamma : the bound to design for, positive; None: the least.
    weights : of the rows of z, already in `system`; None where there are none.
    unweighted : the system before these weights; None where there are none.
    design_constraints : what a design must meet beside gamma.
    plant : the system without the states of filters and integrals; None where there are none.
    observer : what is measured for an observer of `system`; None where the state is fed back.
    """

    system: DelaySystem
    k1: tuple[float, ...] | None
    k2: tuple[float, ...] | None
    gamma: float | None = None
    weights: tuple[float, ...] | None = None
    unweighted: DelaySystem | None = None
    design_constraints: DesignConstraints = field(default_factory=DesignConstraints)
    plant: DelaySystem | None = None
    observer: ObserverSettings | None = None


def system_by_name(name: str) -> NamedSystem:
    """Return a built-in system, or the one in a `.toml` file.

        >>> from cosim.hinf import system_by_name
        >>> paper = system_by_name("paper")
        >>> paper.system
        <DelaySystem 'paper': 2 states, 1 control, 1 disturbance, 2 outputs, delay 0.3 s, uncertain>
        >>> paper.k1, paper.k2
        ((0.6,), (0.2,))

    Raises
    ------
    InputError : no such system, or a file that does not hold one.
    """
    if name == "paper":
        return NamedSystem(paper_example.system(), (paper_example.K1,), (paper_example.K2,))
    if name == "auv":
        return NamedSystem(problem.auv_system(), problem.DEFAULT_K1, problem.DEFAULT_K2)
    if not name.endswith(".toml"):
        raise unknown_system(name)
    return load_system(name)


def unknown_system(name: str, where: str | None = None) -> InputError:
    """Return the error for a name that is neither a built-in system nor a file of one."""
    hint = _OTHER_FILES.get(Path(name).suffix, "a system of your own is a TOML file")
    known = (*BUILT_IN_SYSTEMS, "FILE.toml")
    return InputError.unknown("system", name, known, where=where, hint=hint.format(file=name))


def load_system(path: str | Path) -> NamedSystem:
    """Read a system file; the system is named after the file unless it has a name.

    Raises
    ------
    InputError : the file cannot be read, is malformed (with line and content), or does not
        describe a system (with the key, what was expected and what was got).
    """
    path = Path(path)
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise unreadable(path, error) from error
    return system_from_toml(text, where=str(path), name=path.stem)


def system_from_toml(text: str, *, where: str, name: str) -> NamedSystem:
    """Read a system from TOML text; messages name `where`, and `name` is used if it has none.

    Raises
    ------
    InputError : as `load_system`.
    """
    file = validated(SystemFile, text, SYSTEM_FILE.from_toml(text, where), where)
    findings = Findings(Origin((Layer(where, text),)))
    table, design = file.system, file.design
    with findings.at("system"):
        system = table.system(_delays(table, findings), name)
    unweighted, plant, observer = None, None, None
    if table.weights is not None:
        unweighted = system
        with findings.at("system", "weights"):
            system = problem.weighted(unweighted, table.weights, where="system.weights")
    N = len(system.delays)
    if table.integral or file.weights:
        plant = system
        system = _with_more_states(system, file, findings)
        unweighted = unweighted and _with_more_states(unweighted, file, findings)
    if file.measurements is not None or file.observer:
        system, observer = measured(file, system, findings)
        N = len(system.delays)
    with findings.at("design"):
        k1 = counted_as(design.k1, N, "design.k1", "delay")
        k2 = counted_as(design.k2, N, "design.k2", "delay")
        if design.gamma is not None and not (system.has_performance or observer):
            raise InputError(
                "this system has no gain to bound",
                where="design.gamma",
                expected="no gamma, or a system with C and with D, D1 or D2",
                got=str(design.gamma),
            )
        constraints = design_constraints_of(
            system, **design.model_dump(include=set(KEYS)), where="design"
        )
    return NamedSystem(
        *(system, k1, k2, design.gamma, table.weights, unweighted, constraints, plant, observer)
    )


def _delays(table: SystemTable, findings: Findings) -> list[Delay]:
    """Return the delays of either spelling."""
    if table.d is None:
        return table.terms(findings, ("system",))
    A1 = np.zeros(table.A.shape) if table.A1 is None else table.A1
    with findings.at("system", "A1"):
        fitted(Delay, table.d, A1)
    with findings.at("system", "H1"):
        return [fitted(Delay, table.d, A1, table.H1)]


def _with_more_states(system: DelaySystem, file: SystemFile, findings: Findings) -> DelaySystem:
    """Return the system with the filters and integrals of a file."""
    if file.weights:
        given = {"z": file.weights.z, "w": file.weights.w}
        with findings.at("weights"):
            filters = {key: _filter(part, f"weights.{key}") for key, part in given.items() if part}
            system = problem.filtered(system, **filters)
    if file.system.integral:
        part = file.system.integral
        with findings.at("system", "integral"):
            integrated = part.of
            if isinstance(integrated, list):
                integrated = problem.states_of(integrated, "system.integral.of")
            system = problem.with_integral(system, integrated, weights=part.weights, age=part.age)
    return system


def _filter(part: FilterPart, where: str) -> problem.Filter:
    if part.numerators is None or part.denominators is None:
        return problem.Filter.from_matrices(**part.model_dump(include={*"ABCD"}), where=where)
    rows = list(zip(part.numerators, part.denominators, strict=True))
    return problem.Filter.from_coefficients(rows, where=where)
