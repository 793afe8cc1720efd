"""Rows of the report that take no search: the vehicle, the lemmas, the proofs, the misprints."""

from __future__ import annotations

import math

import pytest
from scipy import optimize

from cosim.hinf import analyse
from cosim.paper import (
    COUNTEREXAMPLES,
    SECTIONS,
    How,
    Row,
    Verdict,
    lemma_rows,
    misprint_rows,
    model_rows,
    theorem_1_rows,
    theorem_2_rows,
)


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


def test_lemmas() -> None:
    """Lemma 2 needs square matrices; of Lemma 3 the transposes of (iii) are exchanged."""
    rows = named(lemma_rows())
    corrected = {what for what, row in rows.items() if row.verdict is Verdict.CORRECTED}
    assert corrected == {"Lemma 2: the size of M1, M2", "Lemma 3 (iii)"}
    assert {rows[w].verdict for w in rows.keys() - corrected} == {Verdict.HOLDS}


def test_theorem_1_agrees_with_the_functional_except_one_block() -> None:
    """Eq. (10) holds; Pi_13 lacks D_K' D1 / gamma; any other slip would be seen."""
    rows = named(theorem_1_rows())
    assert rows["Theorem 1, Eq. (10)"].verdict is Verdict.HOLDS
    assert rows["Eq. (11)"].verdict is Verdict.HOLDS
    assert rows["Eq. (13), the blocks of Π"].verdict is Verdict.CORRECTED
    assert "differ from the functional: Π13;" in rows["Eq. (13), the blocks of Π"].computed


def test_theorem_2_has_two_misprinted_blocks() -> None:
    """The congruence of the proof gives every block printed but Omega_12 and Omega_25."""
    rows = named(theorem_2_rows())
    assert rows["Eq. (14): Ω12"].verdict is Verdict.CORRECTED
    assert rows["Eq. (14): Ω25"].verdict is Verdict.CORRECTED
    assert rows["the LMI that cosim design proves"].verdict is Verdict.CORRECTED
    for what in ("Eq. (16)", "Eqs. (17), (18)", "Eq. (14): all blocks but Ω12 and Ω25"):
        assert rows[what].verdict is Verdict.HOLDS


def test_printed_theorem_accepts_what_the_corrected_one_refuses() -> None:
    """Proved feasible as printed, although the loop diverges; no condition of ours proves it."""
    rows = named(misprint_rows())
    for example in COUNTEREXAMPLES:
        row = rows[f"Theorem 2 with {example.name} as printed"]
        assert (row.verdict, row.how) == (Verdict.IMPOSSIBLE, How.CERTIFIED)
        assert row.value == example.abscissa > 0
        assert f"(14) is feasible at k1 = {example.k1:g}, k2 = {example.k2:g}" in row.computed
        assert analyse(example.case.system).gamma is None


def test_first_counterexample_has_a_root_that_a_bisection_finds() -> None:
    """x' = -x + 2 x(t - 0.3): s + 1 = 2 exp(-0.3 s) has a positive real solution."""
    root = optimize.brentq(lambda s: s + 1 - 2 * math.exp(-0.3 * s), 0.0, 1.0)
    assert COUNTEREXAMPLES[0].abscissa == pytest.approx(float(root), abs=1e-9)
