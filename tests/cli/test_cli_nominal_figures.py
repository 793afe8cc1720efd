"""What the command line says beside a proof: norm, bound, margins, the price of uncertainty."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim

BENCHMARK = """
[system]
A = [[-2.0, 0.0], [0.0, -0.9]]
A1 = [[-1.0, 0.0], [-1.0, -1.0]]
d = 1.0
"""
"""Stable exactly for d < 6.172581371 (published)."""


def test_design_reports_nominal_figures(tmp_path: Path) -> None:
    """|D1| = 5 <= exact norm < its proved bound < gamma; its nominal part on request."""
    words = ("design", "paper", "--k1", "0.6", "--k2", "0.2", "--order", "theorem-2")
    plain = cosim(*words, "--json", cwd=tmp_path).json
    assert 5.0 <= plain["exact_norm"] < plain["exact_norm_upper"] < plain["gamma"]
    assert plain["gamma_over_exact_norm"] == plain["gamma"] / plain["exact_norm"]
    assert plain["delay_margin"] == [None]
    assert (plain["gamma_nominal"], plain["paid_for_uncertainty"]) == (None, None)
    priced = cosim(*words, "--uncertainty-price", "--json", cwd=tmp_path).json
    assert priced["exact_norm_upper"] < priced["gamma_nominal"] < priced["gamma"]
    assert priced["paid_for_uncertainty"] == priced["gamma"] - priced["gamma_nominal"]
    assert {k: v for k, v in priced.items() if "nominal" not in k and "paid" not in k} == {
        k: v for k, v in plain.items() if "nominal" not in k and "paid" not in k
    }
    seen = cosim(*words, "--uncertainty-price", cwd=tmp_path).out
    for message in ("without uncertainty", "at most", "margin of delay 1", "none"):
        assert message in seen


def test_analysis_reports_the_delay_margin(tmp_path: Path) -> None:
    """The benchmark: 6.172581371, whatever is certified; nothing for a loop that is not stable."""
    (tmp_path / "benchmark.toml").write_text(BENCHMARK, "utf-8")
    found = cosim("analyse", "benchmark.toml", "--json", cwd=tmp_path).json
    assert found["delay_margin"] == [pytest.approx(6.172581371, abs=1e-9)]
    assert (found["exact_norm"], found["exact_norm_upper"]) == (None, None)
    assert "6.17258 s" in cosim("analyse", "benchmark.toml", cwd=tmp_path).out
    lost = ("analyse", "benchmark.toml", "--delays", "6.2")
    found = cosim(*lost, "--json", cwd=tmp_path).json
    assert (found["certified"], found["delay_margin"]) == (False, [None])
    assert found["abscissa"] > 0
    assert "margin" not in cosim(*lost, cwd=tmp_path).out


def test_no_price_without_uncertainty(tmp_path: Path) -> None:
    """Nothing uncertain: nothing is paid. Stability alone: there is no gamma to pay with."""
    idle = BENCHMARK + "B = [[0.0], [0.0]]\n"
    certain = idle + "C = [[1.0], [0.0]]\nD = [[1.0, 0.0]]\n"
    (tmp_path / "certain.toml").write_text(certain, "utf-8")
    words = ("--k1", "-0.5", "--k2", "0.5", "--uncertainty-price", "--json")
    found = cosim("design", "certain.toml", *words, cwd=tmp_path).json
    assert (found["gamma_nominal"], found["paid_for_uncertainty"]) == (found["gamma"], 0.0)
    (tmp_path / "idle.toml").write_text(idle, "utf-8")
    found = cosim("design", "idle.toml", *words, cwd=tmp_path).json
    assert (found["gamma"], found["gamma_nominal"]) == (None, None)
    assert found["paid_for_uncertainty"] is None
