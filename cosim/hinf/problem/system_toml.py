"""Systems by name (`paper`, `auv`), or as TOML files with the symbols of Eq. (7).

One delay, with the symbols of the paper::

    [system]
    A = [[-5.0, 0.0], [6.0, -10.0]]     # likewise B, C, D, D1, D2, E, H
    A1 = [[-1.0, 0.0], [2.0, 1.0]]      # likewise H1
    d = 0.3

Any number of delays: in place of A1, H1, d one table each::

    [[system.delays]]
    d = 1.25
    A = [[...]]         # zero where absent; likewise H
    feedback = true     # u = K x(t-d); or one truth value per state: [true, false]
    any_age = true      # every time-varying delay up to d
    least_age = 0.5     # and never less than this
    rate = 0.1          # the age is continuous, |age'| <= rate
    sampled = true      # the age is least_age, grows at rate one, is at most d at the next sample

Optional in [system]: `weights`, one positive number per row of z (of D, D1 and D2), and
`feedback`, one truth value per state: which are fed back at once. A state that is fed back
nowhere is not measured; its column of K is zero.

The F of the uncertainty E F(t) [H_0 ... H_N] is one full block, or block diagonal::

    [system]
    uncertainty_blocks = [[1, 1], [2, 3]]  # columns of E, rows of H of each; [1, 1]: a parameter

Integral action (`cosim.hinf.problem.feedback_structure`), the states counted from 1::

    [system.integral]
    of = [1, 3]          # states, or rows of their combinations: [[0.0, 1.0, -1.0]]
    weights = [0.1, 0.1] # of the integrals in z; absent: 0.1/d times those of the states
    age = 0.1            # s, greatest age of an integral where it acts; 0: it acts at once

Weights that depend on frequency (`cosim.hinf.problem.filters`), of z, of w or of both, as
state-space or, for a diagonal filter, as transfer functions by falling powers of s::

    [weights.z]
    A = [[-0.1]]                          # likewise B, C and, where it is not zero, D
    [weights.w]
    numerators = [[1.0]]                  # one per w; here 1 / (10 s + 1)
    denominators = [[10.0, 1.0]]

Measurements with ages of their own, and an observer of them (`cosim.hinf.problem.measurements`)::

    [[measurements]]
    name = "position"
    states = [1]        # or C = [[1.0, 0.0]]
    d = 1.5             # any age up to this, unless any_age = false; or, as a delay has it,
    least_age = 0.5     # what else is known of the age: least_age, rate, sampled
    noise = 0.1
    over = "link"       # or "onboard"

    [observer]          # not needed where an observer is
    known = [3]         # states that only u and known states act on
    command_age = 0.5   # any age up to this, unless command_any_age = false

`schema = 1` above the tables says the version of their keys (`cosim.core.file_kinds`).

Optional settings of a design, k1 and k2 one number per delay, with its constraints
(`cosim.hinf.problem.design_constraints`)::

    [design]
    k1 = [0.6]
    k2 = [0.2]
    gamma = 5.05
    decay = 0.5         # 1/s
    damping = 0.6       # least damping ratio of the nominal loop's roots s
    within = 2.0        # 1/s, with Re s >= -within
    gain_limit = 2.0    # on |K|
    peak_control = 3.0  # on every |u_i|, from offset and energy
    offset = [1.0, 0.0]
    energy = 1.0
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import SYSTEM_FILE, InputError, unreadable
from cosim.hinf import problem
from cosim.hinf.certificate import (
    assembled,
    delay_from,
    known_keys,
    matrix_from_rows,
    number,
    refused,
    seconds,
)
from cosim.hinf.exact import format_value
from cosim.hinf.problem.design_constraints import (
    DesignConstraints,
    design_constraints_from_table,
)
from cosim.hinf.problem.measurements import ObserverSettings, measured_from_tables
from cosim.hinf.problem.misplaced_keys import AT_THE_TOP, IN_DESIGN, IN_SYSTEM, OTHER_FILES
from cosim.hinf.problem.system_keys import DESIGN, FILTER, INTEGRAL, SYSTEM
from cosim.models import (
    Delay as Delay,  # noqa: PLC0414 - the face of this package offers it
    DelaySystem as DelaySystem,  # noqa: PLC0414 - the same
    paper_example,
)

BUILT_IN_SYSTEMS = ("paper", "auv")
"""Names of the systems that need no file."""

_ONE_DELAY = ("d", "A1", "H1")


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
    hint = OTHER_FILES.get(Path(name).suffix, "a system of your own is a TOML file")
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
    data = SYSTEM_FILE.from_toml(text, where)
    tables = ("system", "design", "weights", "measurements", "observer")
    known_keys(data, where, tables, required=("system",), hints=AT_THE_TOP)
    table, place = data["system"], f"{where}: system"
    known_keys(table, place, tuple(SYSTEM), required=("A",), hints=IN_SYSTEM)
    system = assembled(table, _delays(table, place), place, name)
    weights, unweighted = None, None
    if "weights" in table:
        weights, unweighted = _numbers(table["weights"], f"{place}.weights"), system
        system = problem.weighted(unweighted, weights, where=f"{place}.weights")
    N, plant = len(system.delays), None
    if "integral" in table or "weights" in data:
        plant = system
        system = _with_more_states(system, data, where)
        unweighted = None if unweighted is None else _with_more_states(unweighted, data, where)
    observer = None
    if "measurements" in data or "observer" in data:
        system, observer = measured_from_tables(data, system, where)
        N = len(system.delays)
    place = f"{where}: design"
    design = data.get("design", {})
    known_keys(design, place, tuple(DESIGN), hints=IN_DESIGN)
    k1 = _scalars(design["k1"], f"{place}.k1", N) if "k1" in design else None
    k2 = _scalars(design["k2"], f"{place}.k2", N) if "k2" in design else None
    if k2 is not None and 0.0 in k2:
        raise InputError(
            "k2 is zero", where=f"{place}.k2", expected="no zero (Theorem 2)", got=str(list(k2))
        )
    gamma = number(design["gamma"], f"{place}.gamma") if "gamma" in design else None
    if gamma is not None and not (system.has_performance or observer):
        raise InputError(
            "this system has no gain to bound",
            where=f"{place}.gamma",
            expected="no gamma, or a system with C and with D, D1 or D2",
            got=str(gamma),
        )
    if gamma is not None and gamma <= 0:
        raise InputError(
            "gamma is not positive", where=f"{place}.gamma", expected="> 0", got=str(gamma)
        )
    design_constraints = design_constraints_from_table(design, system, place)
    return NamedSystem(
        *(system, k1, k2, gamma, weights, unweighted, design_constraints, plant, observer)
    )


def _delays(data: dict[str, Any], where: str) -> list[Delay]:
    """Return the delays of either spelling."""
    n = len(data["A"]) if isinstance(data["A"], list) else 0
    one = [key for key in _ONE_DELAY if key in data]
    if "delays" in data:
        if one:
            raise InputError(
                "one delay and a list of delays at once",
                where=where,
                expected="either d, A1, H1 or [[system.delays]]",
                got=f"{', '.join(one)} beside delays",
            )
        tables = data["delays"]
        if not isinstance(tables, list):
            raise InputError(
                "not a list of delays",
                where=f"{where}.delays",
                expected="[[system.delays]], double brackets",
                got="[system.delays], single brackets"
                if isinstance(tables, dict)
                else format_value(tables),
            )
        return [delay_from(table, f"{where}.delays[{i}]", n) for i, table in enumerate(tables)]
    if one and (one == ["d"] or "d" not in one):
        raise InputError(
            "half a delay",
            where=where,
            expected="d, and A1 or H1 (or both)",
            got=", ".join(one),
            hint="a delay of the feedback alone is a table [[system.delays]], with "
            f"d = {format_value(data.get('d', 0.3))}, feedback = true, any_age = true",
        )
    if not one:
        return []
    A1 = matrix_from_rows(data["A1"], f"{where}.A1") if "A1" in data else np.zeros((n, n))
    H1 = matrix_from_rows(data["H1"], f"{where}.H1") if "H1" in data else None
    d = seconds(data["d"], f"{where}.d")
    try:
        return [Delay(d, A1, H1)]
    except ValueError as error:
        raise refused(error, f"{where} (d, A1, H1)") from error


def _with_more_states(system: DelaySystem, data: dict[str, Any], where: str) -> DelaySystem:
    """Return the system with the filters and integrals of a file."""
    if "weights" in data:
        tables = data["weights"]
        known_keys(tables, f"{where}: weights", ("z", "w"))
        filters = {key: _filter(tables[key], f"{where}: weights.{key}") for key in tables}
        system = problem.filtered(system, **filters)
    if "integral" in data["system"]:
        settings = _integral(data["system"]["integral"], f"{where}: system.integral")
        system = problem.with_integral(system, **settings)
    return system


def _filter(table: Any, where: str) -> problem.Filter:
    """Read a filter from its table, in either spelling."""
    quotients = ("numerators", "denominators")
    known_keys(table, where, tuple(FILTER))
    spelling = quotients if any(key in table for key in quotients) else ("A", "B", "C")
    allowed = quotients if spelling is quotients else ("A", "B", "C", "D")
    known_keys(table, where, allowed, required=spelling)
    if spelling is not quotients:
        matrices = {key: matrix_from_rows(table[key], f"{where}.{key}") for key in table}
        return problem.Filter.from_matrices(**matrices, where=where)
    rows = []
    for key in quotients:
        if not isinstance(table[key], list):
            raise InputError(
                "not a list of polynomials",
                where=f"{where}.{key}",
                expected="one list of coefficients each",
                got=format_value(table[key]),
            )
        rows.append([_numbers(row, f"{where}.{key}[{i}]") for i, row in enumerate(table[key])])
    if len(rows[0]) != len(rows[1]):
        raise InputError(
            "numerators and denominators do not match",
            where=where,
            expected="one denominator per numerator",
            got=f"{len(rows[0])} and {len(rows[1])}",
        )
    return problem.Filter.from_coefficients(list(zip(*rows, strict=True)), where=where)


def _integral(table: Any, where: str) -> dict[str, Any]:
    """Return the arguments of `with_integral` in a table."""
    known_keys(table, where, tuple(INTEGRAL), required=("of",))
    settings: dict[str, Any] = {}
    of = table["of"]
    if isinstance(of, list) and of and isinstance(of[0], list):
        settings["integrated"] = matrix_from_rows(of, f"{where}.of")
    else:
        states = _numbers(of, f"{where}.of")
        settings["integrated"] = problem.states_of(states, f"{where}.of")
    if "weights" in table:
        settings["weights"] = _numbers(table["weights"], f"{where}.weights")
    if "age" in table:
        settings["age"] = number(table["age"], f"{where}.age")
    return settings


def _scalars(value: Any, where: str, count: int) -> tuple[float, ...]:
    """Read one number per delay; a single number where there is one delay."""
    values = value if isinstance(value, list) else [value]
    if len(values) != count:
        raise InputError(
            "not one number per delay",
            where=where,
            expected=f"a list of {count}",
            got=f"{len(values)} of them",
        )
    return _numbers(values, where)


def _numbers(values: Any, where: str) -> tuple[float, ...]:
    if not isinstance(values, list):
        raise InputError(
            "not a list of numbers", where=where, expected="a list", got=format_value(values)
        )
    return tuple(number(x, f"{where}[{i}]") for i, x in enumerate(values))
