"""State feedback and Eq. (7) over scalars against matrix algebra by numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import symengine

from cosim.models import (
    clamped_command,
    feedback_command,
    linear_derivatives,
    linear_output,
    paper_example,
    product,
)

LETTERS = ("A", "A1", "B", "C", "D", "D1", "D2", "E", "H", "H1")


def drawn(n: int, m: int, q: int, p: int, seed: int) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    shapes = {"A": (n, n), "A1": (n, n), "B": (n, m), "C": (n, q), "D": (p, n), "D1": (p, q)}
    shapes |= {"D2": (p, m), "E": (n, n), "H": (n, n), "H1": (n, n)}
    return {letter: generator.normal(size=shape) for letter, shape in shapes.items()}


@pytest.mark.parametrize(("n", "m", "q", "p"), [(1, 1, 1, 1), (2, 1, 1, 2), (4, 3, 2, 5)])
def test_equation_7_matches_matrix_products(n: int, m: int, q: int, p: int) -> None:
    """The derivative and z agree with numpy's matrix products, uncertainty included."""
    M = drawn(n, m, q, p, seed=n)
    generator = np.random.default_rng(n + 1)
    x, late, u, w = (generator.normal(size=k) for k in (n, n, m, q))
    t, amplitude, omega = 0.7, 0.5, 1.3
    F = amplitude * math.sin(omega * t) * np.eye(n)
    expected = (M["A"] + M["E"] @ F @ M["H"]) @ x + (M["A1"] + M["E"] @ F @ M["H1"]) @ late
    expected = expected + M["B"] @ u + M["C"] @ w
    lists: Any = {letter: matrix.tolist() for letter, matrix in M.items()}
    got = linear_derivatives(t, x, [late], u, w, lists, (amplitude, omega), math)
    assert got == pytest.approx(expected, rel=1e-13, abs=1e-13)
    z = M["D"] @ x + M["D1"] @ w + M["D2"] @ u
    assert linear_output(x, u, w, lists) == pytest.approx(z, rel=1e-13, abs=1e-13)


def nothing(rows: int, columns: int) -> list[list[float]]:
    """A matrix of these sizes, one of which may be zero."""
    return np.zeros((rows, columns)).tolist()  # type: ignore[no-any-return]


@pytest.mark.parametrize(("s", "r"), [(1, 3), (3, 1), (2, 2)])
@pytest.mark.parametrize("delays", [0, 1, 3])
def test_several_delays_and_a_rectangular_f(delays: int, s: int, r: int) -> None:
    """F(t) is (s, r) with its one number on the main diagonal; F'F <= I for any sizes."""
    generator = np.random.default_rng(10 * s + r + delays)
    A = generator.normal(size=(delays + 1, 2, 2))
    H = generator.normal(size=(delays + 1, r, 2))
    E, states = generator.normal(size=(2, s)), generator.normal(size=(delays + 1, 2))
    F = 0.5 * math.sin(1.3 * 0.7) * np.eye(s, r)
    expected = sum((A[i] + E @ F @ H[i]) @ states[i] for i in range(delays + 1))
    letters = ["", *map(str, range(1, delays + 1))]
    m: Any = {f"A{i}": A[k].tolist() for k, i in enumerate(letters)}
    m |= {f"H{i}": H[k].tolist() for k, i in enumerate(letters)}
    m |= {"B": nothing(2, 0), "C": nothing(2, 0), "E": E.tolist()}
    got = linear_derivatives(0.7, states[0], states[1:], [], [], m, (0.5, 1.3), math)
    assert got == pytest.approx(expected, rel=1e-13, abs=1e-13)
    certain = linear_derivatives(0.7, states[0], states[1:], [], [], m, None, math)
    plain = sum(A[i] @ states[i] for i in range(delays + 1))
    assert certain == pytest.approx(plain, rel=1e-13, abs=1e-13)


def test_section_5_over_symbols_matches_floats() -> None:
    """Symbols through the equations give the function that floats go through."""
    matrices = {letter: getattr(paper_example, letter) for letter in LETTERS}
    names = symengine.symbols("t x0 x1 l0 l1 u w")
    t, x0, x1, l0, l1, u, w = names
    written = linear_derivatives(t, [x0, x1], [[l0, l1]], [u], [w], matrices, (0.5, 1.0), symengine)
    compiled = symengine.Lambdify(names, written)
    for point in np.random.default_rng(2).normal(size=(20, 7)):
        a = [float(value) for value in point]
        floats = linear_derivatives(
            a[0], a[1:3], [a[3:5]], a[5:6], a[6:7], matrices, (0.5, 1.0), math
        )
        assert np.asarray(compiled(a)) == pytest.approx(floats, rel=1e-13, abs=1e-13)


def test_section_5_matches_the_paper() -> None:
    """The numbers of the paper's section 5, with D and E read as multiples of the identity."""
    assert np.array_equal(paper_example.A, [[-5, 0], [6, -10]])
    assert np.array_equal(paper_example.A1, [[-1, 0], [2, 1]])
    assert np.array_equal(paper_example.B, [[-1], [3]])
    assert np.array_equal(paper_example.C, [[4], [3]])
    assert np.array_equal(paper_example.D, -np.eye(2))
    assert np.array_equal(paper_example.D1, [[4], [3]])
    assert np.array_equal(paper_example.D2, [[3], [-1]])
    assert np.array_equal(paper_example.E, -0.1 * np.eye(2))
    assert np.array_equal(paper_example.H, [[0.2, 0], [1, 2]])
    assert np.array_equal(paper_example.H1, [[-1, 2], [0, -0.3]])
    assert (paper_example.d, paper_example.GAMMA) == (0.3, 5.0)
    assert paper_example.PRINTED_K == (0.6432, -0.5679)


def test_matrix_without_rows_gives_no_entries() -> None:
    """And one that does not fit its vector is refused."""
    assert product((), [1.0, 2.0]) == []
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        product(((1.0, 2.0),), [1.0])


def test_command_is_map_times_gain_times_error() -> None:
    """M K (x - r) as numpy has it; without a map K (x - r)."""
    generator = np.random.default_rng(5)
    K, M = generator.normal(size=(3, 5)), generator.normal(size=(3, 3))
    x, r = generator.normal(size=5), generator.normal(size=5)
    assert feedback_command(K, x, r, M) == pytest.approx(M @ K @ (x - r), rel=1e-13, abs=1e-13)
    assert feedback_command(K, x, r, None) == pytest.approx(K @ (x - r), rel=1e-13, abs=1e-13)


def test_limits_clip_each_value() -> None:
    """As numpy.clip does; a limit of zero shuts an actuator off."""
    values, limits = [-7.0, -1.0, 0.0, 2.5, 9.0, 3.0], [5.0, 5.0, 5.0, 2.5, 2.5, 0.0]
    clipped = np.clip(values, -np.array(limits), limits)
    assert clamped_command(values, limits) == clipped.tolist()
