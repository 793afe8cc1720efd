"""Tables that other readers give back to the bit: csv, pandas, pyarrow."""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from cosim.core.errors import InputError
from cosim.trace import Rows, Signal, Trace, TraceWriter, content_hash
from cosim.trace.table_export import export

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
