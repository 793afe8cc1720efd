"""The notebook of docs/notebooks: every cell runs, in order, and it is committed without output."""

from __future__ import annotations

import ast
import re
from contextlib import chdir
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import nbformat
import pytest
from shared import copied, fmu_store

NOTEBOOK = Path(__file__).parents[2] / "docs" / "notebooks" / "trace-analysis.ipynb"


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does, and return the value of its last expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, str(NOTEBOOK), "exec"), names)  # noqa: S102 - a notebook of this repository
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)  # noqa: S307


def test_the_notebook_finds_why_a_run_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Cell by cell in one namespace; what its text says of the run is so."""
    copied(fmu_store("python"), tmp_path / "fmus")
    names: dict[str, Any] = {}
    cells = nbformat.read(NOTEBOOK, as_version=4).cells
    with chdir(tmp_path):
        values = [run_cell(cell.source, names) for cell in cells if cell.cell_type == "code"]
    plt.close("all")
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


def test_the_notebook_is_committed_without_output() -> None:
    """No output, no count of executions, nothing of the machine on which it was written."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(code) > 10
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert notebook.metadata.language_info == {"name": "python"}
    assert not re.search(r"/(home|tmp|work|root|Users)/|[A-Z]:\\\\", NOTEBOOK.read_text("utf-8"))
