"""Figures of the nominal loop: in designs and analyses, in their files, and without E, H."""

from __future__ import annotations

import json
import math
import pickle

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import Result, analyse, characteristic_roots, design, spectral_abscissa
from cosim.hinf.delay_lti import close, nominal_figures_of
from cosim.hinf.problem import without_uncertainty
from cosim.hinf.synthesis import nominal_gamma
from cosim.models import Delay, DelaySystem, paper_example


@pytest.fixture(scope="module")
def paper() -> Result:
    return design(
        paper_example.system(), (0.6,), (0.2,), gain=[paper_example.PRINTED_K], order=None
    )


def test_printed_gain() -> None:
    """Section 5: -5.138, 5.0276 at 22.9 rad/s, stable for every delay; the bound within 1e-8."""
    found = nominal_figures_of(paper_example.system(), [paper_example.PRINTED_K])
    assert found.abscissa == pytest.approx(-5.138, abs=5e-4)
    assert found.norm_frequency == pytest.approx(22.9, abs=0.05)
    assert found.exact_norm is not None
    assert found.exact_norm_upper is not None
    assert found.exact_norm == pytest.approx(5.0276, abs=5e-5)
    assert found.exact_norm < found.exact_norm_upper <= found.exact_norm * (1 + 1.01e-8)
    assert found.delay_margin == (None,)


def test_norm_that_is_only_a_limit() -> None:
    """1 - 1/(s+1): no frequency, and a bound that is proved all the same."""
    found = nominal_figures_of(DelaySystem([[-1]], C=[[1]], D=[[-1]], D1=[[1]]), np.zeros((0, 1)))
    assert (found.exact_norm, found.norm_frequency, found.delay_margin) == (1.0, None, ())
    assert found.exact_norm_upper is not None
    assert 1.0 < found.exact_norm_upper <= 1 + 1.01e-5


def test_gain_that_falls_to_its_limit_has_a_wider_bound() -> None:
    """Section 5 with the gain of its design: |D1| = 5 at infinity, proved to 1e-5."""
    found = nominal_figures_of(paper_example.system(), [[0.101086, 0.247102]])
    assert (found.exact_norm, found.norm_frequency) == (5.0, None)
    assert found.exact_norm_upper is not None
    assert 5.0 < found.exact_norm_upper <= 5 * (1 + 1.01e-5)


@pytest.mark.parametrize("rate", [1e-100, 1e-9, 1e9, 1e150])
def test_figures_scale_with_the_unit_of_time(rate: float) -> None:
    """x' = r (-x + x(t - 2/r)/2 + w): norm 2; with -2 for 1/2 a margin of 2 pi / (3 sqrt 3 r)."""
    d = 2 / rate
    system = DelaySystem(
        [[-rate]], C=[[rate]], D=[[1]], delays=[Delay(d, [[0.5 * rate]]), Delay(0, [[0]])]
    )
    with np.errstate(over="ignore", invalid="ignore"):
        found = nominal_figures_of(system, np.zeros((0, 1)))
    assert found.exact_norm == pytest.approx(2, rel=1e-9)
    assert found.exact_norm_upper == pytest.approx(2, rel=1e-7)
    assert found.delay_margin == (None, None)
    late = DelaySystem([[-rate]], delays=[Delay(0, [[-2 * rate]])])
    exact = 2 * math.pi / (3 * math.sqrt(3)) / rate
    found = nominal_figures_of(late, np.zeros((0, 1)))
    assert found.delay_margin is not None
    assert found.delay_margin[0] == found.margin_of(0) == pytest.approx(exact, rel=1e-9)


def test_a_delay_too_short_for_any_number_is_none() -> None:
    """x' = -x - x(t - 5e-324)/2: the root is -1.5."""
    system = DelaySystem([[-1]], delays=[Delay(5e-324, [[-0.5]])])
    assert nominal_figures_of(system, np.zeros((0, 1))).abscissa == pytest.approx(-1.5, rel=1e-12)


def test_figures_without_performance_or_stability() -> None:
    """No w and z: roots and margins alone. Not stable: the abscissa alone."""
    quarter = DelaySystem([[0]], delays=[Delay(1.0, [[-1]])])
    found = nominal_figures_of(quarter, np.zeros((0, 1)))
    assert (found.exact_norm, found.exact_norm_upper, found.norm_frequency) == (None, None, None)
    assert found.delay_margin is not None
    assert found.delay_margin[0] == pytest.approx(math.pi / 2)
    late = DelaySystem([[0]], C=[[1]], D=[[1]], delays=[Delay(2.0, [[-1]])])
    found = nominal_figures_of(late, np.zeros((0, 1)))
    assert found.abscissa is not None
    assert found.abscissa > 0
    assert (found.exact_norm, found.exact_norm_upper, found.norm_frequency) == (None, None, None)
    assert (found.delay_margin, found.worst_case) == ((None,), None)


def test_design_and_analysis_have_the_same_figures(paper: Result) -> None:
    """Both are measured in one place."""
    analysis = analyse(paper_example.system(), [paper_example.PRINTED_K], order=0)
    expected = nominal_figures_of(paper_example.system(), [paper_example.PRINTED_K])
    for found in (paper, analysis):
        assert found.figures == expected
        assert found.exact_norm_upper == expected.exact_norm_upper
        assert found.delay_margin == expected.delay_margin


def test_figures_are_computed_when_they_are_read_and_once() -> None:
    """They travel with what is known, and are the same wherever they are read."""
    figures = nominal_figures_of(paper_example.system(), [paper_example.PRINTED_K])
    assert "exact_norm_upper" not in vars(figures)
    with np.errstate(all="raise"):  # of whoever reads
        upper = figures.exact_norm_upper
    assert vars(figures)["exact_norm_upper"] == upper
    there = pickle.loads(pickle.dumps(figures))  # noqa: S301 - of this test
    assert vars(there)["exact_norm_upper"] == upper
    assert "delay_margin" not in vars(there)
    assert there == figures


def test_a_design_comes_back_from_its_file(paper: Result) -> None:
    """All figures, through the text of JSON; and without those an older file does not have."""
    data = json.loads(json.dumps(paper.to_json()))
    back = Result.from_json(data, where="a.json")
    assert back.to_json() == data
    assert back.exact_norm_upper == paper.exact_norm_upper
    assert back.delay_margin == (None,)
    del data["figures"]["exact_norm_upper"], data["figures"]["delay_margin"]
    older = Result.from_json(data, where="a.json")
    assert (older.exact_norm_upper, older.delay_margin) == (None, None)
    assert older.exact_norm == paper.exact_norm


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("delay_margin", [], "a list of 1"),
        ("delay_margin", [None, 1.0], "a list of 1"),
        ("delay_margin", 1.0, "a list of 1"),
        ("delay_margin", ["soon"], "number"),
        ("exact_norm_upper", "5", "number"),
        ("surprise", 1.0, "figures"),
    ],
)
def test_a_file_with_wrong_figures_is_refused(
    paper: Result, key: str, value: object, message: str
) -> None:
    """By name, with what was expected."""
    data = json.loads(json.dumps(paper.to_json()))
    data["figures"][key] = value
    with pytest.raises(InputError, match=message):
        Result.from_json(data, where="a.json")


def test_a_file_without_its_figures_is_refused(paper: Result) -> None:
    data = json.loads(json.dumps(paper.to_json()))
    del data["figures"]["exact_norm"]
    with pytest.raises(InputError, match="figures"):
        Result.from_json(data, where="a.json")


def test_nominal_gamma_is_less_than_the_certified_one(paper: Result) -> None:
    """Between the exact norm and gamma lies the gamma of the same gain with nothing uncertain."""
    assert paper.gamma is not None
    assert paper.exact_norm_upper is not None
    nominal = nominal_gamma(paper)
    assert nominal is not None
    assert paper.exact_norm_upper < nominal < paper.gamma
    plain = without_uncertainty(paper.system)
    assert (plain.E.size, plain.H.size, plain.delays[0].H.size) == (0, 0, 0)
    certain = design(plain, paper.k1, paper.k2, gain=paper.K, order=None)
    assert (certain.gamma, nominal_gamma(certain)) == (nominal, nominal)


@pytest.mark.parametrize("present", [0.3, 1.0])
def test_roots_of_the_vehicle_in_closed_form(present: float) -> None:
    """One axis, s^2 + (p + q s) e^{-s d}: every root satisfies it to 1e-10, by Newton's step."""
    p, q = 0.06, 0.53
    system = DelaySystem(
        [[0, 1], [0, 0]], B=[[0], [1]], delays=[Delay(present, np.zeros((2, 2)), feedback=True)]
    )
    loop = close(system, [[-p, -q]])
    s = characteristic_roots(loop, 12)
    late = np.exp(-s * present)
    f = s * s + (p + q * s) * late
    slope = 2 * s + (q - present * (p + q * s)) * late
    assert np.abs(f / slope).max() < 1e-10
    assert spectral_abscissa(loop) == pytest.approx(s[0].real, abs=1e-10)


def test_undecided_margin_does_not_stop_a_design() -> None:
    """x' = -0.9 x - 0.1 x(t-1/2) - x(t-d), stable for every d with nothing to spare at s = 0."""
    system = DelaySystem([[-0.9]], delays=[Delay(20.0, [[-1]]), Delay(0.5, [[-0.1]])])
    found = analyse(system, order=1)
    assert found.delay_margin is None
    assert found.abscissa is not None
    assert found.abscissa < 0
