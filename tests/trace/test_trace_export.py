"""Tables that other readers give back to the bit: csv, pandas, pyarrow, scipy."""

from __future__ import annotations

import csv
import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from cli.shell import cosim
from scipy.io import loadmat, whosmat

from cosim.core import InputError
from cosim.trace import Rows, Signal, Trace, TraceWriter, content_hash, export

KINDS = [
    Signal("x", unit="m", description="north"),
    Signal("n", kind="int"),
    Signal("on", kind="bool"),
    Signal("word", kind="string"),
]
ROWS: list[list[Any]] = [
    [0.1, -(2**62), True, 'a "quoted", word\nand a line'],
    [math.nan, 3, False, "é"],
    [None, None, None, None],
    [5e-324, 2**62 + 1, True, ""],
]


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    with TraceWriter(tmp_path / "run.mcap", run={"seed": "1"}) as writer:
        kinds = writer.add_topic("/link/up", KINDS, schema_name="t.K")
        plant = writer.add_topic(
            "/plant/output", [Signal("eta.x", unit="m"), Signal("nu.u")], schema_name="t.P"
        )
        for k, row in enumerate(ROWS):
            writer.write(kinds, 100 * (k + 1), row, publish_time_ns=100 * k, sequence=k)
        values = np.random.default_rng(1).normal(size=(50, 2))
        writer.write_rows([Rows(plant, np.arange(50) * 1000 + 400, values)])
        writer.finish({})
    return tmp_path / "run.mcap"


def test_csv_reads_back_to_the_same_bits(trace: Path, tmp_path: Path) -> None:
    written = export(trace, tmp_path / "out", "csv")
    assert [(w.path.name, w.topic, w.rows) for w in written] == [
        ("link.up.csv", "/link/up", 4),
        ("plant.output.csv", "/plant/output", 50),
    ]
    with written[0].path.open(newline="", encoding="utf-8") as stream:
        head, *rows = list(csv.reader(stream))
    assert head == ["time_s", "sent_s", "sequence", "x", "n", "on", "word"]
    assert [row[:3] for row in rows] == [
        [str(100 * (k + 1) / 1e9), str(100 * k / 1e9), str(k)] for k in range(4)
    ]
    assert [row[3:] for row in rows] == [
        ["0.1", str(-(2**62)), "true", ROWS[0][3]],
        ["nan", "3", "false", "é"],
        ["", "", "", ""],
        ["5e-324", str(2**62 + 1), "true", ""],
    ]
    with written[1].path.open(newline="", encoding="utf-8") as stream:
        found = list(csv.DictReader(stream))
    table = Trace(trace).read("/plant/output")
    assert [float(row["eta.x"]) for row in found] == table["eta.x"].tolist()
    assert [float(row["time_s"]) for row in found] == table.delivered.tolist()


def test_parquet_has_units_and_provenance(trace: Path, tmp_path: Path) -> None:
    written = export(trace, tmp_path / "out", "parquet")
    table = pq.read_table(written[0].path)
    assert table.column("x").to_pylist()[0] == 0.1
    assert table.column("x").null_count == table.column("on").null_count == 1
    assert table.column("n").to_pylist() == [row[1] for row in ROWS]
    assert table.column("on").to_pylist() == [row[2] for row in ROWS]
    assert table.column("word").to_pylist() == [row[3] for row in ROWS]
    assert table.schema.field("x").metadata == {b"unit": b"m", b"description": b"north"}
    metadata = table.schema.metadata
    assert metadata[b"cosim.content_hash"].decode() == content_hash(trace)
    assert json.loads(metadata[b"cosim.run"]) == {"seed": "1"}
    assert json.loads(metadata[b"cosim.units"])["x"] == "m"
    assert metadata[b"cosim.topic"] == b"/link/up"
    frame = pd.read_parquet(written[1].path)
    read = Trace(trace).read("/plant/output")
    assert frame["nu.u"].to_numpy().tobytes() == read["nu.u"].tobytes()


def test_wide_table_equals_the_joined_data_frame(trace: Path, tmp_path: Path) -> None:
    names = ["plant.eta", "/link/up:n"]
    (one,) = export(trace, tmp_path / "w.parquet", "parquet", signals=names, wide=True)
    assert one.columns == ("time_s", "plant.eta.x", "/link/up:n")
    expected = Trace(trace).to_pandas(["plant.eta.x", "/link/up:n"])
    got = pd.read_parquet(one.path)
    assert got["time_s"].tolist() == expected.index.tolist()
    for name in one.columns[1:]:
        assert np.array_equal(got[name].astype(float), expected[name].astype(float), equal_nan=True)


def test_topics_signals_and_windows(trace: Path, tmp_path: Path) -> None:
    (one,) = export(
        trace, tmp_path / "a.csv", "csv", topics=["/plant/output"], start=5e-6, end=7e-6
    )
    assert (one.path, one.rows) == (tmp_path / "a.csv", 2)
    (one,) = export(trace, None, "csv", signals=["plant.nu.u"])
    assert (one.path, one.columns[3:]) == (trace.with_name("run.csv"), ("nu.u",))
    written = export(trace, None, "csv")
    assert {w.path.parent for w in written} == {trace.with_name("run-csv")}
    for wrong in ({"topics": ["/plant"]}, {"signals": ["plant.zeta"]}):
        with pytest.raises(InputError):
            export(trace, tmp_path / "b", "csv", **wrong)  # type: ignore[arg-type]


def test_export_to_a_place_that_cannot_be_written_is_refused(trace: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for to in ("csv", "parquet"):
        with pytest.raises(InputError, match="cannot be written"):
            export(trace, tmp_path / "file" / "x", to)  # type: ignore[arg-type]


def test_stamps_of_a_wall_clock_come_in_nanoseconds_too(tmp_path: Path) -> None:
    now = 1_790_000_000_123_456_789
    with TraceWriter(tmp_path / "run.mcap", run={}) as writer:
        topic = writer.add_topic("/a/output", [Signal("x")], schema_name="t.A")
        writer.write(topic, now, [1.0])
        writer.finish({})
    (one,) = export(tmp_path / "run.mcap", None, "csv")
    assert f",{now},{now},1.0" in one.path.read_text()


def test_without_pyarrow_the_extra_is_named(
    trace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"auv-cosim\[tables\]"):
        export(trace, tmp_path / "x", "parquet")
    assert export(trace, tmp_path / "y", "csv")
    assert list((tmp_path / "y").iterdir())


def test_mat_reads_back_to_the_same_bits(trace: Path, tmp_path: Path) -> None:
    """All tables in one file, with units, descriptions and own names; the same bytes each time."""
    written = export(trace, tmp_path / "run.mat", "mat")
    assert [(w.path.name, w.topic, w.rows) for w in written] == [
        ("run.mat", "/link/up", 4),
        ("run.mat", "/plant/output", 50),
    ]
    found = loadmat(tmp_path / "run.mat", simplify_cells=True)
    kinds, plant = found["link_up"], found["plant_output"]
    read = Trace(trace).read_all()
    for name, field in (("eta.x", "eta_x"), ("nu.u", "nu_u")):
        assert plant[field].tobytes() == read["/plant/output"][name].tobytes()
        assert plant["names"][field] == name
    assert plant["time_s"].tobytes() == read["/plant/output"].delivered.tobytes()
    assert (plant["units"]["eta_x"], plant["topic"]) == ("m", "/plant/output")
    assert plant["present"] == {}
    assert kinds["x"].tobytes() == read["/link/up"]["x"].tobytes()
    assert kinds["n"].tolist() == [row[1] or 0 for row in ROWS]
    assert kinds["present"]["n"].tolist() == [1, 1, 0, 1]
    assert list(kinds["word"][:2]) == [row[3] for row in ROWS[:2]]
    assert kinds["sent_s"].tolist() == [0.0, 1e-7, 2e-7, 3e-7]
    assert (kinds["units"]["x"], kinds["descriptions"]["x"]) == ("m", "north")
    assert found["trace"]["content_hash"] == content_hash(trace)
    assert json.loads(found["trace"]["run"]) == {"seed": "1"}
    classes = {name: kind for name, _, kind in whosmat(tmp_path / "run.mat")}
    assert set(classes.values()) == {"struct"}
    export(trace, tmp_path / "again.mat", "mat")
    assert (tmp_path / "again.mat").read_bytes() == (tmp_path / "run.mat").read_bytes()


def test_mat_takes_wide_tables_groups_and_windows(trace: Path, tmp_path: Path) -> None:
    """By the command too, which knows the format by the end of the name."""
    names = ["--signal", "plant.eta", "--signal", "/link/up:n", "--wide"]
    done = cosim("trace", "export", trace, "-o", tmp_path / "w.mat", *names, "--json", cwd=tmp_path)
    assert done.json["format"] == "mat"
    signals = loadmat(tmp_path / "w.mat", simplify_cells=True)["signals"]
    frame = Trace(trace).to_pandas(["plant.eta", "/link/up:n"])
    assert signals["time_s"].tolist() == frame.index.tolist()
    assert signals["link_up_n"].tolist() == frame["/link/up:n"].tolist()
    there = frame["plant.eta.x"].notna().to_numpy()
    assert not there.all()
    assert signals["present"]["plant_eta_x"].astype(bool).tolist() == there.tolist()
    assert signals["names"]["link_up_n"] == "/link/up:n"
    export(trace, tmp_path, "mat", signals=["plant.nu"], start=5e-6, end=7e-6)
    plant = loadmat(tmp_path / "run.mat", simplify_cells=True)["plant_output"]
    assert plant["time_s"].tolist() == [5.4e-6, 6.4e-6]
    assert "eta_x" not in plant


def test_limits_of_mat_are_errors(
    trace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table beyond the size of a variable is refused; one pass or several give the same."""
    export(trace, tmp_path / "a.mat", "mat")
    monkeypatch.setattr("cosim.trace.exports.export._TOGETHER", 1)
    export(trace, tmp_path / "b.mat", "mat")
    assert (tmp_path / "a.mat").read_bytes() == (tmp_path / "b.mat").read_bytes()
    monkeypatch.setattr("cosim.trace.exports.mat_file.LARGEST", 1500)
    with pytest.raises(InputError, match="/plant/output is too large for a MATLAB file"):
        export(trace, tmp_path / "c.mat", "mat")
    assert not (tmp_path / "c.mat").exists()


def test_an_input_and_an_output_of_one_name_are_two_columns(tmp_path: Path) -> None:
    """In a data frame and in every file alike."""
    with TraceWriter(tmp_path / "run.mcap", run={}) as writer:
        for number, direction in enumerate(("output", "input")):
            topic = writer.add_topic(f"/p/{direction}", [Signal("u")], schema_name="t.P")
            writer.write(topic, 0, [float(number)])
        writer.finish({})
    frame = Trace(tmp_path / "run.mcap").to_pandas()
    assert frame.to_dict("list") == {"p.u": [0.0], "/p/input:u": [1.0]}
    for to in ("csv", "parquet", "mat"):
        (one,) = export(tmp_path / "run.mcap", None, to, wide=True)  # type: ignore[arg-type]
        assert one.columns == ("time_s", *frame.columns)


def test_names_for_matlab_are_valid_and_unique(tmp_path: Path) -> None:
    """At most 63 characters, no keyword, none twice, none of what stands beside; of topics too."""
    long = "plant." + "x" * 80
    names = ["eta.x", "eta_x", "K[1,3]", "end", "1st", "units", "é", long, long + "y", "/a", "x_é"]
    names.append("eta-x")
    with TraceWriter(tmp_path / "run.mcap", run={}) as writer:
        for topic in ("/link/a", "/link_a", "/trace"):
            signals = [Signal(name) for name in names]
            writer.write(writer.add_topic(topic, signals, schema_name="t.N"), 0, range(len(names)))
        writer.finish({})
    export(tmp_path / "run.mcap", tmp_path / "run.mat", "mat")
    found = loadmat(tmp_path / "run.mat", simplify_cells=True)
    assert {"trace", "link_a", "link_a_2", "trace_2"} <= set(found)
    table = found["link_a"]
    fields = {table["names"][field]: field for field in table["names"]}
    assert [fields[name] for name in names[:7]] == [
        "eta_x", "eta_x_2", "K_1_3", "x_end", "x_1st", "units_2", "x_",
    ]  # fmt: skip
    assert fields["eta-x"] == "eta_x_3"
    assert len(set(fields.values())) == len(names) + len(["time_s", "sent_s", "sequence"])
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) for name in fields.values())
    assert [table[fields[name]] for name in names] == [*range(len(names))]
