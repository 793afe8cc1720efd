"""The verbs that compare and export traces, as they are typed."""

from __future__ import annotations

import csv
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from cli.shell import cosim, shared_run, trace_of
from shared import copied

from cosim.trace import Trace

AWARE, NAIVE = "auv-acoustic", "auv-acoustic-naive"


def test_diff_of_two_gains_finds_the_first_different_command(tmp_path: Path) -> None:
    """Same start, other gain: the controller's first command that sees the vehicle moved."""
    picture = tmp_path / "apart.png"
    result = cosim(
        "trace", "diff", trace_of(AWARE), trace_of(NAIVE), "--json", "--picture", picture,
        cwd=tmp_path,
    )  # fmt: skip
    assert result.code == 1
    data = result.json
    assert (data["identical"], data["equal"]) == (False, False)
    tables = [Trace(trace_of(name)).read("/controller/output") for name in (AWARE, NAIVE)]
    parts = min(
        int(tables[0].log_time_ns[(tables[0][name] != tables[1][name]).argmax()])
        for name in tables[0].columns
        if (tables[0][name] != tables[1][name]).any()
    )
    assert data["first"]["signal"].startswith("controller.")
    assert data["first"]["time_s"] == parts / 1e9
    assert not any(link["differs"] for link in data["links"])  # the same luck on both links
    assert any("loop_delay = 0.05" in line for line in data["texts"]["scenario.toml"])
    changed = {(entry["where"], entry["key"]) for entry in data["entries"]}
    assert {("cosim.run", "scenario"), ("design.json", "K[0][0]")} <= changed
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert data["picture"] == str(picture)
    seen = cosim("trace", "diff", trace_of(AWARE), trace_of(NAIVE), cwd=tmp_path)
    assert seen.code == 1
    assert "the first to part is controller." in seen.out
    assert "+loop_delay = 0.05" in seen.out


def test_a_trace_is_identical_to_its_copy(tmp_path: Path) -> None:
    copied(trace_of(AWARE), tmp_path / "copy.mcap")
    result = cosim("trace", "diff", trace_of(AWARE), "copy.mcap", "--json", cwd=tmp_path)
    assert result.code == 0
    data = result.json
    assert (data["identical"], data["equal"], data["first"]) == (True, True, None)
    assert data["content_hash"]["a"] == shared_run(AWARE).json["content_hash"]
    assert "identical" in cosim("trace", "diff", trace_of(AWARE), "copy.mcap", cwd=tmp_path).out


def test_tolerances_decide_the_exit_code(tmp_path: Path) -> None:
    words = ("trace", "diff", trace_of(AWARE), trace_of(NAIVE))
    assert cosim(*words, "--abs", "1e6", cwd=tmp_path).code == 0
    assert cosim(*words, "--rel", "2.1", cwd=tmp_path).code == 0
    tight = ("--abs", "1e6", "--signal", "plant.eta.x=0.01")
    result = cosim(*words, *tight, "--json", cwd=tmp_path)
    assert result.code == 1
    assert [s["name"] for s in result.json["signals"] if s["differing"]] == ["plant.eta.x"]
    loose = ("--abs", "1e6", "--signal", "plant.eta=0.01,3")
    assert cosim(*words, *loose, cwd=tmp_path).code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--signal", "plant.eta.x"), "not a tolerance"),
        (("--signal", "=1"), "name of the signal is missing"),
        (("--signal", "plant.eta.x=much"), "not a tolerance"),
        (("--signal", "plant.zeta=1"), "there is no signal"),
        (("--abs", "-1"), "not a tolerance"),
        (("--rel", "nan"), "not a tolerance"),
        (("--picture", "/dev/null/a.png"), "cannot be written"),
        (("--picture", "a.doc"), "cannot be written"),
    ],
)
def test_diff_refuses(tmp_path: Path, arguments: tuple[str, str], message: str) -> None:
    words = ("trace", "diff", trace_of(AWARE), trace_of(NAIVE), *arguments, "--json")
    result = cosim(*words, cwd=tmp_path)
    assert result.code == 2
    assert message in result.error["what"]


def test_diff_of_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_text("no trace")
    for other in ("x.mcap", "none.mcap"):
        result = cosim("trace", "diff", trace_of(AWARE), other, "--json", cwd=tmp_path)
        assert result.code == 2
        assert other in result.error["where"]


def test_export_reports_its_files(tmp_path: Path) -> None:
    source = trace_of("paper-example")
    result = cosim("trace", "export", source, "-o", "tables", "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    files = {one["topic"]: one for one in result.json["files"]}
    table = Trace(source).read("/plant/output")
    reported = files["/plant/output"]
    assert (reported["rows"], reported["columns"][3:]) == (len(table), list(table.columns))
    with (tmp_path / reported["path"]).open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["x[1]"]) for row in rows] == table["x[1]"].tolist()
    words = ("trace", "export", source, "--to", "parquet", "--signal", "plant.x", "--wide")
    result = cosim(*words, "--start", "1", "--end", "2", "-o", "w.parquet", "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    (one,) = result.json["files"]
    read = pq.read_table(tmp_path / "w.parquet")
    assert read.column_names == one["columns"] == ["time_s", "plant.x[1]", "plant.x[2]"]
    window = Trace(source).read("/plant/output", start=1.0, end=2.0)
    assert read.column("plant.x[2]").to_pylist() == window["x[2]"].tolist()
    assert "tables" in cosim("trace", "export", source, "-o", "tables", cwd=tmp_path).out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--topic", "/nothing"), "there is no topic"),
        (("--signal", "nothing"), "there is no signal"),
        (("--start", "2", "--end", "1"), "ends before"),
        (("--to", "xls"), "xls"),
    ],
)
def test_export_refuses(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    words = ("trace", "export", trace_of("paper-example"), *arguments, "--json")
    result = cosim(*words, cwd=tmp_path)
    assert result.code == 2
    assert message in result.error["what"]


@pytest.mark.parametrize("verb", ["diff", "export", "inject"])
def test_help_shows_examples(verb: str, tmp_path: Path) -> None:
    result = cosim("trace", verb, "--help", cwd=tmp_path)
    assert result.code == 0
    assert f"cosim trace {verb} traces/" in result.out.replace("yesterday.mcap", "traces/")


def test_layouts_and_bags_say_what_they_left_out(tmp_path: Path) -> None:
    trace = trace_of(AWARE)
    data = cosim("trace", "layout", trace, "--json", "-o", "a.json", cwd=tmp_path).json
    assert (data["for"], data["left_out"]) == ("lichtblick", 0)
    assert list(data["tabs"]) == ["plant", "controller", "sea", "links"]
    words = ("trace", "layout", trace, "--for", "plotjuggler", "-o", "a.xml")
    assert "a.xml" in cosim(*words, cwd=tmp_path).out
    words = ("trace", "export", trace, "-o", "bag.mcap")  # --to ros2, by the file's name
    data = cosim(*words, "--topic", "/auv/pose", "--end", "10", "--json", cwd=tmp_path).json
    assert list(data["topics"]) == ["/auv/pose", "/auv/path"]
    assert "left out, no message of ROS 2 for it: /auv/hull" in cosim(*words, cwd=tmp_path).out
    refused = cosim(*words, "--wide", "--json", cwd=tmp_path)
    assert (refused.code, refused.error["where"]) == (2, "--wide")
