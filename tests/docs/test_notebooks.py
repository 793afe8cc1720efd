"""The notebooks of docs/notebooks: every cell runs, in order, and what their text says is so."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from shared import copied, fmu_store

from docs_site.notebook_run import NOTEBOOKS, Cell, read, run_notebook, texts_of


def shows_what_is_stored(name: str, cells: list[Cell]) -> str:
    """Check that the notebook has what its cells show, numbers apart; return what they print."""
    stored = [cell.outputs for cell in read(name).cells if cell.cell_type == "code"]
    for number, (cell, outputs) in enumerate(zip(cells, stored, strict=True), 1):
        assert texts_of(cell.outputs(number)) == texts_of(outputs), (
            "python -m docs_site.notebook_run"
        )
    return "".join(cell.printed for cell in cells)


@pytest.mark.slow
def test_the_design_shows_what_an_age_costs(
    tmp_path: Path,
) -> None:
    """gamma grows with the age and lies above the exact norm; the fast gain is unstable late."""
    names, cells = run_notebook("design.ipynb", tmp_path)
    assert "proved again: True" in shows_what_is_stored("design.ipynb", cells)
    assert (np.diff(names["gammas"]) > 0).all()
    assert (names["gammas"] >= names["norms"]).all()
    assert names["late"].verdict == "unstable"
    assert (tmp_path / "what-an-age-costs.pdf").exists()


def test_the_flight_is_taken_back_and_goes_on(
    tmp_path: Path,
) -> None:
    """The guarantee holds; the fault moves the vehicle; after the snapshot it is the run again."""
    copied(fmu_store("python", "native"), tmp_path / "fmus")
    names, cells = run_notebook("flight.ipynb", tmp_path)
    printed = shows_what_is_stored("flight.ipynb", cells)
    assert "finished\n" in printed
    assert all(names["outcome"].metrics["assumptions"].values())
    assert 0.5 < names["oldest"] < 1.25
    assert "the same: True" in printed
    assert np.abs(names["faulty"] - names["healthy"]).max() > 1
    assert (tmp_path / "fault.pdf").exists()


@pytest.mark.slow
def test_the_analysis_finds_why_a_run_failed(
    tmp_path: Path,
) -> None:
    """From the traces of two runs."""
    copied(fmu_store("python", "native"), tmp_path / "fmus")
    names, cells = run_notebook("trace-analysis.ipynb", tmp_path)
    printed = shows_what_is_stored("trace-analysis.ipynb", cells)
    assert "1 of 1 assertions failed" in printed
    assert 26 < names["failed_at"] < 28  # twelve seconds after the outage begins
    forces = [names[when]["plant.force.x"].nunique() for when in ("before", "during")]
    assert forces[0] > forces[1] == 1
    assert names["calm_distance"].max() < 0.5 < names["distance"].max()
    assert 0.01 < (names["depth"][2] - names["depth"][1]).abs().max() < 0.1  # centimetres
    assert "m True" in printed
    for one in cells:
        assert " at 0x" not in repr(one.value)
    assert (tmp_path / "runs" / "outage-1-outage-2.html").exists()


@pytest.mark.parametrize("name", [path.name for path in sorted(NOTEBOOKS.glob("*.ipynb"))])
def test_a_notebook_is_committed_with_what_it_shows(name: str) -> None:
    """In the order of its cells, and with nothing of the machine on which it was run."""
    notebook = read(name)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert any("image/png" in one.get("data", {}) for cell in code for one in cell.outputs)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert notebook.metadata.language_info == {"name": "python"}
    for cell in code:
        for output in cell.outputs:
            output.get("data", {}).pop("image/png", None)
            text = json.dumps(output)
            assert not re.search(r"/(home|tmp|work|root|Users)/|[A-Z]:\\\\", text)
