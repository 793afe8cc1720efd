"""Rows of the report that take no search: the vehicle, the lemmas, the proofs, the misprints."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from scipy import optimize

from cosim.paper import How, Row, Verdict
from cosim.paper.exact import Draw, inverse, is_positive, is_zero, schur
from cosim.paper.lemmas import lemma_3_counterexample, lemma_rows
from cosim.paper.misprints import COUNTEREXAMPLES, accepts, margin, misprint_rows
from cosim.paper.model import agrees, model_rows
from cosim.paper.omega import CORRECTED, PRINTED, Reading
from cosim.paper.proof_2 import differing_blocks, drawn_proof
from cosim.paper.row import SECTIONS
from cosim.paper.theorem_1 import drawn_loop, functional_form, printed_pi, theorem_1_rows, theta
from cosim.paper.theorem_2 import theorem_2_rows


def named(rows: list[Row]) -> dict[str, Row]:
    assert len({row.what for row in rows}) == len(rows)
    assert all(row.section in SECTIONS and row.why for row in rows)
    return {row.what: row for row in rows}


@pytest.fixture(scope="module")
def model() -> dict[str, Row]:
    return named(model_rows())


def test_fifteen_of_sixteen_coefficients_are_reproduced(model: dict[str, Row]) -> None:
    """All but x5 x6 in yaw, which the print has as -0.031 and Table 1 makes -0.0300."""
    coefficients = [row for what, row in model.items() if what.startswith("f(x), row")]
    assert len(coefficients) == 16
    bad = [row for row in coefficients if row.verdict is Verdict.DOES_NOT]
    assert [(row.printed, row.computed) for row in bad] == [("-0.031", "-0.0300")]
    for row in coefficients:
        assert row.value is not None
        assert row.printed_value is not None
        if row.verdict is not Verdict.DOES_NOT:
            assert abs(row.value - row.printed_value) <= 0.0005


def test_coefficients_that_no_misprint_touches_hold_as_printed(model: dict[str, Row]) -> None:
    """Heave is printed without a slip but for a name; surge needs the sign of X_udot."""
    for what in ("x6²", "x8²", "x5 x7", "x6 x8"):
        assert model[f"f(x), row 7 (heave): {what}"].verdict is Verdict.HOLDS
    assert "X_udot" in model["f(x), row 5 (surge): x7²"].why
    assert "N_ur" in model["f(x), row 8 (yaw): x5 x8"].why


def test_an_error_is_counted_once_however_many_claims_show_it(model: dict[str, Row]) -> None:
    """The sign of X_udot: at its own row, in four coefficients and in one entry of the thrust."""
    claims = [row.what for row in model.values() if "X_udot in Table 1" in row.errors]
    assert len(claims) == 6
    assert model["thrust map above Eq. (4): entry (4, 2)"].errors == (
        "thrust map above Eq. (4): entry (2, 4)",
    )
    errors = {error for row in model.values() for error in row.errors}
    assert len(errors) == 9
    assert errors <= set(model)
    assert not any(row.errors for row in model.values() if row.verdict is Verdict.HOLDS)


def test_surge_and_sway_cannot_be_left_without_control(model: dict[str, Row]) -> None:
    """Four of eight states stay out of reach: x, y, u, v; ranks counted by hand are 4 + 2."""
    row = model["section 1: no control is needed in surge and sway"]
    assert (row.verdict, row.value) == (Verdict.DOES_NOT, 6.0)


def test_thrust_map_has_two_wrong_signs(model: dict[str, Row]) -> None:
    """Both entries off the diagonal are 2.40e-6 with a plus."""
    for entry in ("(2, 4)", "(4, 2)"):
        row = model[f"thrust map above Eq. (4): entry {entry}"]
        assert row.verdict is Verdict.CORRECTED
        assert row.value == pytest.approx(2.40e-6, abs=5e-9)
        assert row.printed_value == -2.40e-6


def test_maclaurin_leaves_out_third_order(model: dict[str, Row]) -> None:
    assert model["Maclaurin form of f(x)"].value == pytest.approx(3.0, abs=0.01)


@pytest.mark.parametrize(
    ("value", "text", "same"),
    [("0.1245", "0.124", True), ("0.12451", "0.124", False), ("4.285e-5", "4.29e-5", True)],
)
def test_agreement_is_rounding_to_the_digits_printed(value: str, text: str, same: bool) -> None:  # noqa: FBT001
    assert agrees(Fraction(value), text) is same


def test_lemmas() -> None:
    """Lemma 2 needs square matrices; of Lemma 3 the transposes of (iii) are exchanged."""
    rows = named(lemma_rows())
    corrected = {what for what, row in rows.items() if row.verdict is Verdict.CORRECTED}
    assert corrected == {"Lemma 2: the size of M1, M2", "Lemma 3 (iii)"}
    assert {rows[w].verdict for w in rows.keys() - corrected} == {Verdict.HOLDS}


def test_counterexample_of_lemma_3_in_floating_point() -> None:
    """S < 0 by its eigenvalues, and the printed (iii) has one that is not negative."""
    S11, S12, S22 = (M.astype(float) for M in lemma_3_counterexample())
    whole = np.block([[S11, S12], [S12.T, S22]])
    assert np.linalg.eigvalsh(whole).max() < 0
    assert np.linalg.eigvalsh(S11 - S12.T @ np.linalg.solve(S22, S12)).max() > 0
    assert np.linalg.eigvalsh(S11 - S12 @ np.linalg.solve(S22, S12.T)).max() < 0


def test_theorem_1_agrees_with_the_functional_except_one_block() -> None:
    """Eq. (10) holds; Pi_13 lacks D_K' D1 / gamma; any other slip would be seen."""
    rows = named(theorem_1_rows())
    assert rows["Theorem 1, Eq. (10)"].verdict is Verdict.HOLDS
    assert rows["Eq. (11)"].verdict is Verdict.HOLDS
    assert rows["Eq. (13), the blocks of Π"].verdict is Verdict.CORRECTED
    v = drawn_loop()
    truth = functional_form(v)
    wrong = theta(v)
    wrong[0, 3] += 1
    wrong[3, 0] += 1
    assert is_zero(schur(theta(v), 8) - truth)
    assert not is_zero(schur(wrong, 8) - truth)
    assert not is_zero(truth[:3, 6:] - printed_pi(v)["Π13"])


def test_theorem_2_has_two_misprinted_blocks() -> None:
    """The congruence of the proof gives every block printed but Omega_12 and Omega_25."""
    v = drawn_proof()
    assert differing_blocks(v, CORRECTED) == []
    assert differing_blocks(v, PRINTED) == ["Ω12", "Ω25"]
    assert differing_blocks(v, Reading(omega_12=False)) == ["Ω12"]
    rows = named(theorem_2_rows())
    assert rows["Eq. (14): Ω12"].verdict is Verdict.CORRECTED
    assert rows["Eq. (14): Ω25"].verdict is Verdict.CORRECTED
    assert rows["the LMI that cosim design proves"].verdict is Verdict.CORRECTED
    for what in ("Eq. (16)", "Eqs. (17), (18)", "Eq. (14): all blocks but Ω12 and Ω25"):
        assert rows[what].verdict is Verdict.HOLDS


@pytest.mark.parametrize("example", COUNTEREXAMPLES, ids=lambda x: x.name)
def test_printed_theorem_accepts_what_the_corrected_one_refuses(example: object) -> None:
    """Proved feasible as printed, although the loop diverges; infeasible as corrected."""
    assert isinstance(example, type(COUNTEREXAMPLES[0]))
    assert accepts(example.case, example.reading)
    assert example.abscissa > 0
    assert margin(example.case, CORRECTED)[0] < 0
    assert not accepts(example.case, CORRECTED)


def test_first_counterexample_has_a_root_that_a_bisection_finds() -> None:
    """x' = -x + 2 x(t - 0.3): s + 1 = 2 exp(-0.3 s) has a positive real solution."""
    root = optimize.brentq(lambda s: s + 1 - 2 * math.exp(-0.3 * s), 0.0, 1.0)
    assert COUNTEREXAMPLES[0].abscissa == pytest.approx(float(root), abs=1e-9)
    assert all(row.verdict is Verdict.IMPOSSIBLE for row in misprint_rows())
    assert all(row.how is How.CERTIFIED for row in misprint_rows())


def test_exact_arithmetic_agrees_with_floating_point() -> None:
    """Inverse, Schur complement and definiteness of drawn matrices."""
    draw = Draw(7)
    whole = draw.positive(5)
    floats = whole.astype(float)
    assert np.allclose(inverse(whole).astype(float), np.linalg.inv(floats))
    part = np.linalg.inv(np.linalg.inv(floats)[:2, :2])
    assert np.allclose(schur(whole, 2).astype(float), part)
    assert is_positive(whole)
    assert not is_positive(-whole)
