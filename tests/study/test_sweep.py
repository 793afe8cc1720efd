"""Many runs as one frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from shared import fmu_store

from cosim import run, sweep
from cosim.core import InputError
from cosim.scenario import Scenario

SHORT = Scenario.load("paper-example").set("run.end", 1.0)
GRID: dict[str, Any] = {"run.seed": [1, 2], "components.plant.parameters.delay.d": [0.1, 0.3]}


def test_every_combination_is_a_row_with_the_figures_of_its_run(tmp_path: Path) -> None:
    error = {"signal": "plant.x[1]", "reduce": "max_abs"}
    metrics = {"error": error, "gain": "metrics.gain"}
    store = fmu_store("native")
    frame = sweep(SHORT, GRID, metrics, fmus=store, workers=2, out=tmp_path / "kept")
    assert list(frame.columns) == [*GRID, "status", "error", "gain"]
    assert len(frame) == 4
    assert set(frame["status"]) == {"finished"}
    row = frame.iloc[3]
    alone = SHORT
    for path in GRID:
        alone = alone.set(path, row[path].item())
    assert row["gain"] == run(alone, fmus=store).metrics["gain"]
    again = sweep(SHORT, GRID, metrics, fmus=store, out=tmp_path / "kept")  # nothing is run twice
    assert again.equals(frame)


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({}, "not a grid"),
        ({"links.none.delay": [1]}, "leads nowhere"),
        ({"run.seed": []}, "at least 1 item"),
    ],
)
def test_a_grid_that_is_none_is_refused(grid: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        sweep(SHORT, grid, fmus=fmu_store("native"))
