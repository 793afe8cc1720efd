"""DelaySystem: shapes are checked, absent matrices are zero, matrices are read-only."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.models import Delay, DelaySystem, paper_example

I2 = np.eye(2)


def _arguments(**changes: Any) -> dict[str, Any]:
    """A system of n = 2, m = 1, q = 3, p = 4, F(t) of 2 x 5."""
    return {
        "A": I2,
        "B": np.ones((2, 1)),
        "C": np.ones((2, 3)),
        "D": np.ones((4, 2)),
        "D1": np.ones((4, 3)),
        "D2": np.ones((4, 1)),
        "E": np.ones((2, 2)),
        "H": np.ones((5, 2)),
        "delays": (Delay(1.0, I2, np.ones((5, 2))),),
    } | changes


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": np.ones((2, 3))}, r"A: wrong shape; expected shape \(2, 2\), got \(2, 3\)"),
        ({"A": np.zeros((0, 0))}, "at least one state"),
        ({"A": [[1.0, "x"], [0.0, 1.0]]}, "A: not a matrix of numbers"),
        ({"A": [[1.0, 2.0], [3.0]]}, "A: not a matrix of numbers"),
        ({"A": [1.0, 2.0]}, "A: wrong shape"),
        ({"A": [[np.nan, 0.0], [0.0, 1.0]]}, "A: expected finite numbers, got nan"),
        ({"B": np.ones((3, 1))}, r"B: wrong shape; expected shape \(2, any\), got \(3, 1\)"),
        ({"B": [[np.inf], [0.0]]}, "B: expected finite numbers, got inf"),
        ({"D": np.ones((4, 3))}, r"D: wrong shape; expected shape \(any, 2\)"),
        ({"D1": np.ones((4, 2))}, "disturbances .* C has 3, D1 has 2"),
        ({"D2": np.ones((3, 1))}, "performance outputs .* D has 4, D1 has 4, D2 has 3"),
        ({"D2": np.ones((4, 2))}, "inputs .* B has 1, D2 has 2"),
        ({"H": np.ones((4, 2))}, "rows of H: .* H of delay 1 has 5, H has 4"),
        ({"E": None}, "H without E"),
        ({"uncertainty_blocks": [[1.5, 4], [0.5, 1]]}, "expected a pair of numbers"),
        ({"uncertainty_blocks": [[1, 1], [1, 1]]}, "2 columns of E and 5 rows of H in all, got 2"),
        ({"uncertainty_blocks": [[2, 5], [0, 0]]}, "at least one column and one row each"),
        ({"H": None, "delays": ()}, "E without H"),
        ({"delays": (Delay(1.0, np.eye(3)),)}, r"A of delay 1: expected \(2, 2\), got \(3, 3\)"),
        (
            {"delays": (Delay(1.0, I2, feedback=True), Delay(2.0, I2, feedback=True))},
            r"at most one delay, got delays \[1, 2\]",
        ),
    ],
)
def test_matrix_of_wrong_shape_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    """A wrong matrix is refused with its name, what was expected and what was got."""
    with pytest.raises(ValueError, match=message):
        DelaySystem(**_arguments(**changes))


@pytest.mark.parametrize("d", [-0.1, float("nan"), float("inf")])
def test_a_delay_is_a_finite_number_of_seconds(d: float) -> None:
    """Negative, infinite and undefined delays are refused."""
    with pytest.raises(ValueError, match="delay d: expected a finite number"):
        Delay(d, I2)


@pytest.mark.parametrize(
    ("A", "H"), [(np.ones((2, 3)), None), (I2, np.ones((1, 3))), (np.full((2, 2), np.inf), None)]
)
def test_a_delay_checks_its_matrices(A: Any, H: Any) -> None:
    """A of a delay is square and finite, and its H has as many columns."""
    with pytest.raises(ValueError, match="of a delay"):
        Delay(1.0, A, H)


def test_absent_matrices_are_zero_or_do_not_exist() -> None:
    """A dimension known from one matrix fills its absent neighbours with zeros; else it is 0."""
    full = DelaySystem(**_arguments())
    assert full.E.shape == (2, 2)
    assert full.H.shape == (5, 2)  # F(t) is rectangular, as the paper defines it
    partial = DelaySystem(I2, I2[:, :1], D=np.ones((3, 2)), C=np.ones((2, 2)))
    assert partial.D2.shape == (3, 1)
    assert partial.D1.shape == (3, 2)
    assert not partial.D1.any()
    bare = DelaySystem(I2, delays=(Delay(1.0, I2),))
    assert bare.B.shape == (2, 0)
    assert bare.H.shape == bare.delays[0].H.shape == (0, 2)


def test_d2_without_b_is_refused() -> None:
    """D2 implies inputs: a B of zeros would hide a mistake."""
    with pytest.raises(ValueError, match=r"B: expected shape \(2, 1\) beside D2.*got no B"):
        DelaySystem(I2, D2=np.ones((3, 1)), C=np.ones((2, 2)))
    assert not DelaySystem(I2, np.zeros((2, 1)), D2=np.ones((3, 1))).B.any()


def test_performance_needs_a_disturbance_and_an_output() -> None:
    """Without w or without z there is no gain, only stability."""
    assert DelaySystem(**_arguments()).has_performance
    assert not DelaySystem(**_arguments(C=None, D1=None)).has_performance
    assert not DelaySystem(**_arguments(D=None, D1=None, D2=None)).has_performance


def test_an_absent_h_of_one_delay_is_zero_when_another_is_uncertain() -> None:
    """[H_0 H_1 H_2] has one number of rows; what is not given is certain."""
    system = DelaySystem(
        I2, E=I2, delays=(Delay(1.0, I2), Delay(2.0, I2, np.ones((1, 2)), any_age=True))
    )
    assert system.H.shape == (1, 2)
    assert not system.H.any()
    assert not system.delays[0].H.any()
    assert system.delays[1].H.tolist() == [[1.0, 1.0]]
    assert system.delays[1].any_age


def test_feedback_acts_through_its_delay() -> None:
    """Feedback is immediate unless a delay is marked as feedback."""
    late = DelaySystem(I2, B=I2, delays=(Delay(0.5, I2), Delay(1.25, 0 * I2, feedback=True)))
    assert not late.immediate_feedback
    assert late.feedback_delay == 1.25
    assert DelaySystem(I2, B=I2).immediate_feedback
    assert DelaySystem(I2, B=I2).feedback_delay == 0.0


def test_matrices_are_read_only_copies() -> None:
    """Matrices are read-only copies: neither the caller nor the owner can change them."""
    A = np.eye(2)
    system = DelaySystem(A)
    A[0, 0] = 7.0
    assert system.A[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        system.A[0, 0] = 7.0


def test_the_example_matches_the_paper() -> None:
    """Section 5: |D1| = 5, and the printed loop without delay has the eigenvalues of A + A1 + BK.

    The characteristic polynomial of A + A1 + B K is worked out by hand from the print:
    [[-6 - .6432, .5679], [8 + 1.9296, -9 - 1.7037]].
    """
    system = paper_example.system()
    assert np.linalg.norm(system.D1) == 5.0
    K = np.array([paper_example.PRINTED_K])
    trace, determinant = -6.6432 - 10.7037, 6.6432 * 10.7037 - 0.5679 * 9.9296
    closed = system.A + system.delays[0].A + system.B @ K
    assert np.poly(closed) == pytest.approx([1.0, -trace, determinant], rel=1e-12)
    assert paper_example.system(1.5).delays[0].d == 1.5


def test_the_example_imports_no_numpy() -> None:
    """At module level the example imports nothing but the standard library."""
    assert paper_example.__file__ is not None
    tree = ast.parse(Path(paper_example.__file__).read_text(encoding="utf-8"))
    imported = {
        (node.module if isinstance(node, ast.ImportFrom) else node.names[0].name) or ""
        for node in tree.body
        if isinstance(node, (ast.Import, ast.ImportFrom))
    }
    assert {name.split(".")[0] for name in imported} <= sys.stdlib_module_names
