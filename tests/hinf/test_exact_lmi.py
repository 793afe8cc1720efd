"""The table of the exact certificate against the functional's derivative and the solver's LMI."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag
from solver_points import Array, Point, random_system, value

from cosim.hinf import as_cvxpy
from cosim.hinf.exact import exact_matrix, identity
from cosim.models import DelaySystem


def _system(
    rng: np.random.Generator, *, late: bool, any_age: bool, blocks: list[list[int]]
) -> DelaySystem:
    """Any system, with these blocks of F."""
    several = blocks if len(blocks) > 1 else None
    return random_system(rng, late=late, any_age=any_age, uncertain=bool(blocks), blocks=several)


def _random_point(rng: np.random.Generator, system: DelaySystem) -> Point:
    """Positive matrices that need not solve anything."""

    def positive() -> Array:
        G = rng.standard_normal((2, 2))
        return G @ G.T + np.eye(2)

    unknowns: dict[str, Any] = {"gamma": 50.0}
    for name in "QR":
        for j, x in enumerate(system.delays):
            is_zero = name == "Q" and x.any_age
            unknowns[f"{name}[{j}]"] = np.zeros((2, 2)) if is_zero else positive()
    # eps small: the p-part of the functional below stays negative definite
    k1, k2 = (tuple(rng.uniform(0.2, 1, 2) * rng.choice((-1, 1), 2)) for _ in range(2))
    unknowns |= {f"eps[{b}]": (1e-3, 3e-3)[b] for b in range(len(system.blocks))}
    return Point(k1, k2, unknowns | {"X": positive()})


def _omega(system: DelaySystem, K: Array, v: Point) -> tuple[Array, list[str]]:
    """Omega in doubles, and the block name of every row."""
    proof = v.proof(system, K)
    form = list(proof.theorem.inequalities(system, K, bounded=proof.gamma is not None))[-1]
    lower = form.at(proof.unknowns)
    result = np.zeros((len(lower), len(lower)))
    for i, row in enumerate(lower):
        for j, entry in enumerate(row):
            result[i, j] = result[j, i] = -float(Fraction(int(entry.p), int(entry.q)))
    return result, [name for name, size in form.rows.items() for _ in range(size)]


def _eliminated(matrix: Array, keep: list[int]) -> Array:
    """Schur complement onto the indices `keep`: the maximum over all the others."""
    rest = [i for i in range(len(matrix)) if i not in keep]
    if not rest:
        return matrix
    assert np.linalg.eigvalsh(matrix[np.ix_(rest, rest)]).max() < 0
    cross = matrix[np.ix_(keep, rest)]
    block = np.linalg.solve(matrix[np.ix_(rest, rest)], cross.T)
    result: Array = matrix[np.ix_(keep, keep)] - cross @ block
    return result


def _form(q: Callable[[Array], float], size: int) -> Array:
    """Matrix of a quadratic form, from its values."""
    e = np.eye(size)
    values = np.array([q(e[i]) for i in range(size)])
    pairs = np.array([[q(e[i] + e[j]) for j in range(size)] for i in range(size)])
    form: Array = (pairs - values[:, None] - values[None, :]) / 2
    return form


def _derivative_bound(system: DelaySystem, K: Array, v: Point) -> Callable[[Array], float]:
    """V' + z'z/gamma - gamma w'w + (|sum H_i x_i|^2 - |p|^2)/eps as a function of (x_i, w, p).

    V is the functional; p = F sum H_i x_i, so that the last bracket, one for each block of F with
    an eps of its own, is not negative for any admissible F. For each delay, from
    int (R x' + M s)' R^-1 (R x' + M s) >= 0 with s = (x, x_j), M s = k1 P x + k2 P x_j:
    -int x''R x' <= 2 (M s)'(x - x_j) + d (M s)' R^-1 (M s).
    """
    unknowns, gamma = v.unknowns, v.unknowns["gamma"]
    P = np.linalg.inv(unknowns["X"])
    A = [system.A, *(x.A for x in system.delays)]
    H = [system.H, *(x.H for x in system.delays)]
    acts = [system.immediate_feedback, *(x.feedback for x in system.delays)]
    N, q = len(system.delays), system.C.shape[1]

    def bound(vector: Array) -> float:
        x = [vector[2 * i : 2 * i + 2] for i in range(N + 1)]
        w = vector[2 * N + 2 : 2 * N + 2 + q]
        p = vector[2 * N + 2 + q :]
        u = K @ x[acts.index(True)]
        rate = sum(A[i] @ x[i] for i in range(N + 1)) + system.B @ u + system.C @ w + system.E @ p
        z = system.D @ x[0] + system.D1 @ w + system.D2 @ u
        total = 2 * x[0] @ P @ rate
        for j, delay in enumerate(system.delays):
            R_bar = unknowns[f"R[{j}]"]
            Q, R = P @ unknowns[f"Q[{j}]"] @ P, np.linalg.inv(R_bar)
            Ms = v.k1[j] * P @ x[0] + v.k2[j] * P @ x[j + 1]
            total += x[0] @ Q @ x[0] - x[j + 1] @ Q @ x[j + 1] + delay.d * rate @ R @ rate
            total += 2 * Ms @ (x[0] - x[j + 1]) + delay.d * Ms @ R_bar @ Ms
        if system.E.size:
            y = np.sum([H[i] @ x[i] for i in range(N + 1)], axis=0)
            for b, (own, rows) in enumerate(system.blocks):
                eps = unknowns[f"eps[{b}]"]
                total += (y[rows] @ y[rows] - p[own] @ p[own]) / eps
        return float(total + z @ z / gamma - gamma * w @ w)

    return bound


CASES = [
    (late, any_age, blocks)
    for late in (False, True)
    for any_age in (False, True)
    for blocks in ([], [[3, 2]], [[1, 1], [2, 1]])
]


@pytest.mark.parametrize(("late", "any_age", "blocks"), CASES)
def test_the_table_is_the_functionals_derivative(
    late: bool,  # noqa: FBT001
    any_age: bool,  # noqa: FBT001
    blocks: list[list[int]],
) -> None:
    """Omega, with z, x', Lemma 2 and h eliminated, is the bound of V' built from the definition."""
    rng = np.random.default_rng(7)
    for _ in range(3):
        system = _system(rng, late=late, any_age=any_age, blocks=blocks)
        v = _random_point(rng, system)
        K = rng.standard_normal((1, 2))
        whole, names = _omega(system, K, v)
        kept = [i for i, name in enumerate(names) if name in ("x", "x1", "x2", "w")]
        ours = _eliminated(whole, kept)
        bound = _form(_derivative_bound(system, K, v), 8 + system.E.shape[1])
        truth = _eliminated(bound, list(range(8)))
        # x = X xhat in every x row: P does not stand in Omega
        T = block_diag(*[v.unknowns["X"]] * 3, np.eye(2))
        expected = T.T @ truth @ T
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("late", "any_age", "blocks"), CASES)
def test_the_cvxpy_form_is_the_exact_one(
    late: bool,  # noqa: FBT001
    any_age: bool,  # noqa: FBT001
    blocks: list[list[int]],
) -> None:
    """With constants of cvxpy for the unknowns, and with Y = K X beside the gain itself."""
    rng = np.random.default_rng(11)
    system = _system(rng, late=late, any_age=any_age, blocks=blocks)
    v = _random_point(rng, system)
    K = rng.standard_normal((1, 2))
    exactly, _ = _omega(system, K, v)
    asked = as_cvxpy(system, v.k1, v.k2)
    u = v.unknowns
    eps = [u[f"eps[{b}]"] for b in range(len(system.blocks))]
    given = [(asked.X, u["X"]), (asked.Y, K @ u["X"]), (asked.gamma, u["gamma"])]
    given += [(asked.eps, eps[0] if len(eps) == 1 else eps)] if eps else []
    given += [(R, u[f"R[{j}]"]) for j, R in enumerate(asked.R)]
    given += [
        (Q, u[f"Q[{j}]"])
        for j, (Q, x) in enumerate(zip(asked.Q, system.delays, strict=True))
        if not x.any_age
    ]
    for variable, number in given:
        variable.value = np.asarray(number)
    found = value(asked.constraints[0].args[0])
    np.testing.assert_allclose(exactly, -found, rtol=0, atol=1e-12 * 50)


def test_an_identity_is_written_to_without_harm() -> None:
    """A proof that changes one leaves those of others as they are."""
    identity(3)[0, 1] = 5
    assert identity(3) == exact_matrix(np.eye(3))
