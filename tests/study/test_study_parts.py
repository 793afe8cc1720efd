"""Parts of one study executed in different places, and merged."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from study.deadly import MANIFEST, RESULTS, plan
from study.run_logs import Cells, write_bare

from cosim.core import InputError
from cosim.study import execute_study, merge_studies, read_table

VALUES = [0.1 * i for i in range(6)]


def executed(out: Path, part: str | None = None, **more: Any) -> Path:
    """The folder of these runs."""
    made = plan(VALUES, traces="worst:1 by x", **more)
    execute_study(made, out, runs=None if part is None else made.part(part))
    return out


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the whole study, and with two parts that overlap by one run."""
    place = tmp_path_factory.mktemp("parts")
    for name, part in {"whole": None, "first": ":3", "second": "2:6"}.items():
        executed(place / name, part)
    return place


@pytest.mark.slow
def test_merged_parts_are_the_study_bit_for_bit(parts: Path, tmp_path: Path) -> None:
    """The table has the bytes of one flown in one place, the one trace that it keeps is there.

    A part has no table; it is read by what is done. One that is merged later completes a folder.
    """
    assert read_table(parts / "second")[0]["run"].to_pylist() == [2, 3, 4, 5]
    assert not (parts / "second" / RESULTS).exists()
    early = merge_studies([parts / "first"], tmp_path / "out")
    assert (early.runs, early.missing, early.results) == (3, ("3:6",), tmp_path / "out")
    done = merge_studies([parts / "first", parts / "second"], tmp_path / "out")
    assert (done.runs, done.twice, done.missing) == (6, 3, ())
    assert (done.traces, done.without_trace) == (1, ())
    for name in (RESULTS, "traces/run-5.mcap"):
        assert (tmp_path / "out" / name).is_file()
    whole = (parts / "whole" / RESULTS).read_bytes()
    assert done.results.read_bytes() == whole
    assert execute_study(plan(VALUES, traces="worst:1 by x"), tmp_path / "out").executed == 0


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (("study", "seed", 7), "seed: null and 7"),
        (("fmus", "tiny.fmu", "0" * 64), "FMU tiny.fmu"),
        (("versions", "numpy", "1.0"), "version of numpy"),
        (("parts", "scenario", "0" * 64), "hash of the scenario"),
        (("digest", None, "0"), "another digest"),
    ],
)
def test_parts_of_different_studies_are_refused_by_what_differs(
    parts: Path, tmp_path: Path, change: tuple[str, str | None, Any], named: str
) -> None:
    """Study, FMU, version, scenario; nothing is written."""
    other = shutil.copytree(parts / "second", tmp_path / "other")
    manifest = json.loads((other / MANIFEST).read_text())
    part, key, value = change
    if key is None:
        manifest[part] = value
    else:
        manifest[part][key] = value
    (other / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="not parts of one study") as refused:
        merge_studies([parts / "first", other], tmp_path / "out")
    assert named in refused.value.text()
    assert not (tmp_path / "out").exists()


def test_a_run_with_two_results_is_refused(parts: Path, tmp_path: Path) -> None:
    """The last bit of one value: run and folders are named, and nothing is merged."""
    other = shutil.copytree(parts / "second", tmp_path / "other")

    def changed(rows: list[Cells]) -> list[Cells]:
        *before, x = next(row for row in rows if row[0] == 2)
        return [[*before, x * (1 + 2**-52)], *(row for row in rows if row[0] != 2)]

    write_bare(other, changed)
    with pytest.raises(InputError, match="run 2 has other results") as refused:
        merge_studies([parts / "first", other], tmp_path / "out")
    assert str(other) in refused.value.text()
    assert read_table(tmp_path / "out")[0].num_rows == 0


@pytest.mark.parametrize("text", ["3", "3:3", "0:7", "-1:2", "a:b", "4:2"])
def test_what_is_no_part_of_the_runs_is_refused(text: str) -> None:
    """With the form that is meant."""
    with pytest.raises(InputError, match="not a part of the study's runs"):
        plan(VALUES).part(text)
