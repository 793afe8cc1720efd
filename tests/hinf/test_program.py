"""What a solver gets is what is proved: the same matrices, in other units and cut into parts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import flint
import numpy as np
import pytest
from solver_points import random_system

from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi import Program
from cosim.hinf.theorems import (
    Age,
    Inequality,
    Loop,
    Modes,
    corners_of,
    minus_omega,
    minus_phi,
    minus_phi_of_design,
    minus_phi_of_outages,
    positive,
    positive_of_ages,
    positive_of_outages,
)
from cosim.models import Delay, DelaySystem

Both = tuple[list[Inequality], list[Inequality]]
FIXED = {"gamma": 2.0, "1/gamma": 0.5}
NOTHING: Any = {"late": False, "any_age": False, "uncertain": True}
GAIN = np.array([[0.3, -0.2, 0.0, 0.1]])


def two_parts(**kinds: Any) -> DelaySystem:
    """Two pairs of states that nothing connects but what is uncertain of each alone."""
    pair = np.array([[-1.0, 0.7], [0.2, -2.0]])
    none = np.zeros((2, 2))
    A = np.block([[pair, none], [none, 2 * pair]])
    return DelaySystem(
        A,
        B=np.eye(4)[:, :1],
        C=np.eye(4)[:, [0, 2]],
        D=np.eye(4)[[1, 3]],
        D1=0.1 * np.eye(2),
        D2=np.zeros((2, 1)),
        E=np.eye(4)[:, [0, 3]],
        H=0.2 * np.eye(4)[[1, 2]],
        uncertainty_blocks=[(1, 1), (1, 1)],
        delays=[Delay(0.4, 0.1 * A), Delay(0.3, 0 * A, feedback=True, **kinds)],
    )


def of_ages(functional: str, order: int, **kinds: Any) -> Callable[[], Both]:
    def make() -> Both:
        system = two_parts(**kinds)
        gain = GAIN * [[1, 1, 0, 0]]
        loop = Loop.of(system, gain)
        ages = [Age(loop, 0, "constant", order), Age(loop, 1, functional, order)]
        main = [minus_phi(loop, ages, corner, bounded=True) for corner in corners_of(ages)]
        return main, list(positive_of_ages(4, ages))

    return make


def of_a_design() -> Both:
    system = two_parts(any_age=True)
    loop = Loop.of(system, np.zeros((1, 4)))
    ages = [Age(loop, 0, "constant", 1), Age(loop, 1, "interval", 1)]
    by = {"r": exact_matrix(0.3 * np.eye(4)), "W0,0": exact_matrix(0.1 * np.eye(4))}
    main = [minus_phi_of_design(system, ages, by, c, bounded=True) for c in corners_of(ages)]
    return main, list(positive_of_ages(4, ages))


def of_theorem_2() -> Both:
    system = two_parts()
    k = [exact(-1.0)] * 2, [exact(1.0)] * 2
    return [minus_omega(system, *k, bounded=True)], positive(system)


def of_outages() -> Both:
    system = two_parts(any_age=True)
    modes = Modes(exact(0.1), exact(0.2), exact(2.0), (exact(0.8), exact(0.9)), 0.5 * GAIN, 0.2)
    main = [minus_phi_of_outages(system, GAIN, modes, lost=lost) for lost in (False, True)]
    return main, list(positive_of_outages(system))


CASES: dict[str, Callable[[], Both]] = {
    "constant": of_ages("constant", 2),
    "any age": of_ages("jensen", 2, any_age=True),
    "interval": of_ages("interval", 1, any_age=True, least_age=0.1),
    "rate": of_ages("rate", 1, any_age=True, rate=0.5),
    "wirtinger": of_ages("wirtinger", 0, any_age=True, sampled=True),
    "looped": of_ages("looped", 1, any_age=True, sampled=True, least_age=0.1),
    "a design": of_a_design,
    "Theorem 2": of_theorem_2,
    "outages": of_outages,
}


def exactly(values: dict[str, Any]) -> dict[str, Any]:
    return {
        name: exact(v) if isinstance(v, float) else exact_matrix(np.asarray(v))
        for name, v in values.items()
    }


def matrix(form: Inequality, values: dict[str, Any]) -> Any:
    """The exact matrix at a point, as doubles."""
    lower = form.at(exactly(values))
    found = np.zeros((len(lower),) * 2)
    for i, row in enumerate(lower):
        found[i, : i + 1] = [float(flint.fmpq(x)) for x in row]
    return found + np.tril(found, -1).T


@pytest.mark.parametrize("case", CASES)
def test_the_matrices_of_the_solver_are_those_that_are_proved(case: str) -> None:
    """At random points: the same eigenvalues of -Phi, the same signs of them of the others."""
    main, others = CASES[case]()
    program = Program(main, others, {})
    of_main, of_others = program.constraints(FIXED)
    assert len(of_main) > len(main) or case in ("a design", "Theorem 2", "outages")
    for seed in range(3):
        y = np.random.default_rng(seed).standard_normal(program.cost([], FIXED).size)
        values = program.values(y, FIXED)
        whole = [np.linalg.eigvalsh(matrix(form, values)) for form in main]
        cut = [np.linalg.eigvalsh(c.at(y)) for c in of_main]
        one, other = (np.sort(np.concatenate(x)) for x in (whole, cut))
        assert one == pytest.approx(other, rel=1e-9, abs=1e-9)
        signs = [np.linalg.eigvalsh(matrix(form, values)) for form in others]
        signs_cut = [np.linalg.eigvalsh(c.at(y)) for c in of_others]
        for sign in (1, -1):
            count, count_cut = (sum((sign * v > 0).sum() for v in x) for x in (signs, signs_cut))
            assert count == count_cut


def test_units_of_rows_change_no_matrix_but_by_a_congruence() -> None:
    """A row is its unit times the solver's: the eigenvalues are those of D M D."""
    main, others = CASES["interval"]()
    units = {"x": np.array([2.0, 0.5, 1.0, 3.0]), "w": np.array([0.1, 4.0])}
    program = Program(main, others, units)
    y = np.random.default_rng(0).standard_normal(program.cost([], FIXED).size)
    values, found = program.values(y, FIXED), []
    for form in main:
        D = np.concatenate([units.get(name, np.ones(n)) for name, n in form.rows.items()])
        found.append(np.linalg.eigvalsh(D[:, None] * matrix(form, values) * D))
    cut = [np.linalg.eigvalsh(c.at(y)) for c in program.constraints(FIXED)[0]]
    one, other = (np.sort(np.concatenate(x)) for x in (found, cut))
    assert one == pytest.approx(other, rel=1e-9, abs=1e-9)


def test_no_coefficient_is_far_from_one() -> None:
    """However small an age or large a matrix: units follow from the terms."""
    system = random_system(np.random.default_rng(1), scale=1e3, **NOTHING)
    loop = Loop.of(system, np.zeros(system.B.T.shape))
    ages = [Age(loop, j, "constant", 1) for j in range(len(loop.delays))]
    main = [minus_phi(loop, ages, corner, bounded=True) for corner in corners_of(ages)]
    program = Program(main, list(positive_of_ages(len(system.A), ages)), {})
    for constraint in (c for both in program.constraints(FIXED) for c in both):
        assert np.abs(constraint.columns).max() < 100.0  # of 1.7e6 without units
