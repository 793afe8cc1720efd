"""Repeat a run from the folder of its results: the study as it was run, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.shell import cosim
from shared import copied
from study.studies_at_hand import study_folder

from cosim.study import read_table


@pytest.mark.slow
def test_a_run_is_repeated_as_the_study_had_it(tmp_path: Path) -> None:
    """Samples and scenario are those of the folder; the metrics are those of the table."""
    folder = study_folder("mixed")
    rows = read_table(folder)[0].to_pylist()
    row = next(row for row in reversed(rows) if row["status"] == "finished")
    done = cosim("study", "repeat", folder, str(row["run"]), "--json", cwd=tmp_path).json
    assert done["final"]["tiny.x"] == row["x"]
    assert (tmp_path / "traces" / f"mixed-run-{row['run']}.mcap").is_file()


@pytest.mark.parametrize(
    ("key", "value", "cause"),
    [
        ("digest", "0" * 64, "would not be that of the study"),
        ("scenario_folder", "no/such/folder", "scenario is not here"),
    ],
)
def test_what_is_no_longer_the_same_is_not_run(
    key: str, value: str, cause: str, tmp_path: Path
) -> None:
    """Exit code 2; the message names what differs, or what is missing."""
    folder = copied(study_folder("one"), tmp_path / "one")
    manifest = json.loads((folder / "study.json").read_text("utf-8"))
    (folder / "study.json").chmod(0o600)
    (folder / "study.json").write_text(json.dumps(manifest | {key: value}), "utf-8")
    found = cosim("study", "repeat", "one", "0", "--json", cwd=tmp_path)
    assert found.code == 2
    assert cause in found.error["what"]
