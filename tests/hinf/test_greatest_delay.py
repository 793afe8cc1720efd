"""Remark 3 and the search of k1, k2: the end of an interval, certified, never beyond the truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from shared import sampled
from solver_points import benchmark

from cosim.core import InputError, NotAchievableError
from cosim.hinf import check_certificate, design, greatest_delay
from cosim.hinf.problem import with_delays
from cosim.hinf.synthesis import delay_by_theorem_2
from cosim.models import paper_example

BENCHMARK_END = 6.172581371  # published: stable for d below, and only there
THEOREM_1_END = 4.47214  # published as 4.472 for conditions with full matrices as k1, k2


@pytest.mark.parametrize(
    ("gamma", "end"),
    [(6.0, 1.0428), (8.0, None), (10.0, None), (13.0, None), (20.0, 1.2180)],
)
def test_table_2_at_the_printed_k1_k2(gamma: float, end: float | None) -> None:
    """The corrected LMI's greatest delays, certified below and refuted just above."""
    found = greatest_delay(paper_example.system(), gamma, (paper_example.K1,), (paper_example.K2,))
    assert end is None or found.delay == pytest.approx(end, abs=6e-5)
    assert not found.limit_reached
    assert found.refuted_at is not None
    assert found.delay < found.refuted_at < found.delay * 1.0001
    beyond = check_certificate(json.loads(json.dumps(found.refutation)))
    assert beyond.valid
    assert beyond.claim["delays"][0]["d"] == found.refuted_at
    assert found.result.gamma == gamma
    proof = check_certificate(found.result.certificate)
    assert proof.valid
    assert proof.claim["delays"][0]["d"] == found.delay


@pytest.mark.parametrize("gamma", [4.0, 5.0])
def test_gamma_up_to_the_norm_of_d1_is_refused(gamma: float) -> None:
    """gamma <= ||D1|| = 5: refused with the reason, whatever k1, k2."""
    with pytest.raises(NotAchievableError, match="D1"):
        greatest_delay(paper_example.system(), gamma, (0.6,), (0.2,), search=True)


@pytest.mark.parametrize(
    "gamma", sampled([gamma for gamma, _ in paper_example.TABLE_2 if gamma >= 6], 2)
)
def test_searched_table_2_ends_at_the_limit_alone(gamma: float) -> None:
    """Section 5 can be made stable for every delay: the limit is reached and said."""
    found = greatest_delay(paper_example.system(), gamma, (0.6,), (0.2,), search=True, limit=20.0)
    assert found.delay == 20.0
    assert found.limit_reached
    assert found.refuted_at is None
    assert check_certificate(found.result.certificate).valid
    assert found.result.abscissa < 0


def test_a_delay_beyond_ten_times_the_printed_one() -> None:
    """k1 = -.01, k2 = .05, gamma = 6: certified at 15, and the LMI ends before 20."""
    system = with_delays(paper_example.system(), [15.0])
    found = design(system, (-0.01,), (0.05,), gamma=6.0)
    assert check_certificate(found.certificate).valid
    end = greatest_delay(paper_example.system(), 6.0, (-0.01,), (0.05,), limit=100.0)
    assert 15.0 < end.delay < 20.0
    assert end.refuted_at is not None
    assert end.delay < end.refuted_at < 20.0
    assert check_certificate(end.refutation).valid


@pytest.mark.parametrize("d", sampled([1000.0, 10.0, 100.0], 1))
def test_k1_k2_scaled_by_the_delay_certify_any_delay(d: float) -> None:
    """k1 = -.1/d, k2 = .5/d at gamma = 6: certified at every d tried."""
    system = with_delays(paper_example.system(), [d])
    assert design(system, (-0.1 / d,), (0.5 / d,), gamma=6.0).gamma == 6.0


def test_the_benchmark_is_certified_short_of_its_exact_end() -> None:
    """Searched: above 4.4, not above what free matrices in place of k1, k2 give, nor the truth."""
    found = delay_by_theorem_2(benchmark(1.0), None, (-0.1,), (0.2,), search=True)
    assert 4.4 < found.delay < THEOREM_1_END < BENCHMARK_END
    assert check_certificate(found.result.certificate).valid


def test_search_brings_section_5_to_its_bound() -> None:
    """At d = .3 no gamma is below 5; searched, 5.001 is certified, and twice the same."""
    first, second = (design(paper_example.system(), (0.6,), (0.2,), search=True) for _ in range(2))
    assert first.gamma is not None
    assert 5.0 < first.gamma <= 5.001
    assert check_certificate(first.certificate).valid
    assert json.dumps(first.certificate) == json.dumps(second.certificate)


def test_bad_requests_are_refused() -> None:
    """An absent delay, no gamma, an invalid limit, delays that do not fit."""
    system = paper_example.system()
    for wrong in ({"delay_index": 1}, {"delay_index": -1}, {"limit": 0.0}, {"limit": np.inf}):
        with pytest.raises(InputError):
            greatest_delay(system, 6.0, (0.6,), (0.2,), **wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="gamma"):
        greatest_delay(system, None, (0.6,), (0.2,))
    for lengths in ([], [1.0, 2.0], [-1.0], [np.nan]):
        with pytest.raises(InputError, match="delay"):
            with_delays(system, lengths)


def _design(folder: Path, *arguments: str) -> tuple[int, Any]:
    result = cosim("design", "paper", *arguments, "--json", cwd=folder)
    return result.code, result.json


@pytest.mark.slow
def test_design_command_reports_the_greatest_delay_as_json(tmp_path: Path) -> None:
    """--max-delay, --search, --delays: lists per delay, null for what is absent, a path saved."""
    path = str(tmp_path / "c.json")
    code, output = _design(tmp_path, "--gamma", "6", "--max-delay", "--search", "--save", path)
    assert code == 0
    assert (output["gamma"], output["delays"], output["limit_reached"]) == (6.0, [20.0], True)
    assert (output["certified"], output["certificate"]) == (True, path)
    assert np.shape(output["K"]) == (1, 2)
    saved = json.loads(Path(path).read_text(encoding="utf-8"))
    assert check_certificate(saved).valid
    code, output = _design(tmp_path, "--gamma", "6", "--max-delay", "--delay-limit", "1")
    assert (code, output["delays"], output["limit_reached"]) == (0, [1.0], True)
    assert (output["k1"], output["k2"], output["certificate"]) == ([0.6], [0.2], None)
    code, output = _design(tmp_path, "--delays", "0.2")
    assert (code, output["delays"], output["limit_reached"]) == (0, [0.2], None)
    assert output["exact_norm"] < output["gamma"]
    assert output["abscissa"] < 0
    assert _design(tmp_path, "--gamma", "5", "--max-delay")[0] == 5
    assert _design(tmp_path, "--delays", "0.2,0.3")[0] == 2
    assert _design(tmp_path, "--max-delay")[0] == 2
