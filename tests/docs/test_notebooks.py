"""The notebooks of docs/notebooks: every cell runs, in order, and what their text says is so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from docs.notebook_cells import NOTEBOOKS, is_clean, run_notebook
from shared import copied, fmu_store


@pytest.mark.slow
def test_the_design_shows_what_an_age_costs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """gamma grows with the age and lies above the exact norm; the fast gain is unstable late."""
    names, _ = run_notebook("design.ipynb", tmp_path)
    assert "proved again: True" in capsys.readouterr().out
    assert (np.diff(names["gammas"]) > 0).all()
    assert (names["gammas"] >= names["norms"]).all()
    assert names["late"].verdict == "unstable"
    assert (tmp_path / "what-an-age-costs.pdf").exists()


def test_the_flight_is_taken_back_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The guarantee holds; the fault moves the vehicle; after the snapshot it is the run again."""
    copied(fmu_store("python", "native"), tmp_path / "fmus")
    names, _ = run_notebook("flight.ipynb", tmp_path)
    printed = capsys.readouterr().out
    assert "finished\n" in printed
    assert all(names["outcome"].metrics["assumptions"].values())
    assert 0.5 < names["oldest"] < 1.25
    assert "the same: True" in printed
    assert np.abs(names["faulty"] - names["healthy"]).max() > 1
    assert (tmp_path / "fault.pdf").exists()


@pytest.mark.slow
def test_the_analysis_finds_why_a_run_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the traces of two runs."""
    copied(fmu_store("python", "native"), tmp_path / "fmus")
    names, values = run_notebook("trace-analysis.ipynb", tmp_path)
    printed = capsys.readouterr().out
    assert "1 of 1 assertions failed" in printed
    assert 26 < names["failed_at"] < 28  # twelve seconds after the outage begins
    forces = [names[when]["plant.force.x"].nunique() for when in ("before", "during")]
    assert forces[0] > forces[1] == 1
    assert names["calm_distance"].max() < 0.5 < names["distance"].max()
    assert 0.01 < (names["depth"][2] - names["depth"][1]).abs().max() < 0.1  # centimetres
    assert "m True" in printed
    for one in values:
        assert " at 0x" not in repr(one)
    assert (tmp_path / "runs" / "outage-1-outage-2.html").exists()


@pytest.mark.parametrize("name", [path.name for path in sorted(NOTEBOOKS.glob("*.ipynb"))])
def test_a_notebook_is_committed_without_output(name: str) -> None:
    """Nothing of the machine on which it was written."""
    assert is_clean(name)
