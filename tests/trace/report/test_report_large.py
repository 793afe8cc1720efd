"""The report of a large trace: what it measures is exact, and what it draws has every extreme."""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.writer import Writer
from report_pages import report_of

from cosim.page import packed_values
from cosim.trace import Rows, Signal, Table, Trace, TraceWriter

REFERENCE = Path(__file__).parents[3] / "traces" / "reference" / "auv-acoustic.mcap"
TURNS = 50
"""How often the recording comes, one after the other: some 13,000 rows on each topic."""
BULK, BULKY_ROWS = 200, {"small": 10, "large": 20_000}
"""Signals that never change, and rows: four million values are those of a large trace."""

Row = tuple[int, int, int, bytes, Channel, Schema | None]


def recorded(path: Path, turns: int) -> Iterator[Row]:
    """Log time, publish time, number, payload and channel of each message, turn after turn."""
    with path.open("rb") as stream:
        messages = [
            (m.log_time, m.publish_time, m.sequence, m.data, channel, schema)
            for schema, channel, m in make_reader(stream).iter_messages()
        ]
    length = messages[-1][0] + 10**7
    for turn in range(turns):
        for log, publish, sequence, *rest in messages:
            yield (log + turn * length, publish + turn * length, sequence + turn * 10_000, *rest)


def repeated(path: Path, bulk: Path) -> Path:
    """A recording that comes again and again, among the messages of another file."""
    rows = heapq.merge(recorded(REFERENCE, TURNS), recorded(bulk, 1), key=lambda row: row[0])
    with REFERENCE.open("rb") as source, path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "test")
        reader = make_reader(source)
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for item in reader.iter_attachments():
            writer.add_attachment(0, 0, item.name, item.media_type, item.data)
        ids: dict[str, int] = {}
        for log, publish, sequence, data, channel, schema in rows:
            if channel.topic not in ids:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(ids[channel.topic], log, data, publish, sequence)
        writer.finish()
    return path


def bulky(path: Path, last_ns: int, rows: int) -> Path:
    """Rows of zeros over the same time."""
    with TraceWriter(path, run={}) as writer:
        signals = [Signal(f"x[{i}]") for i in range(BULK)]
        topic = writer.add_topic("/bulk/output", signals, schema_name="t.B")
        times = np.linspace(0, last_ns, rows).astype(np.int64)
        writer.write_rows([Rows(topic, times, np.zeros((rows, BULK)))])
        return writer.finish({})


def without_bulk(text: str) -> str:
    """What a page has in front of its provenance, without the rows of zeros in its table."""
    before = text.partition('<section id="provenance">')[0]
    rows = re.findall(r"<tr><td>/bulk/output</td>.*</tr>\n", before)
    assert len(rows) == BULK
    for row in rows:
        before = before.replace(row, "")
    return before


def test_a_report_read_in_parts_says_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figures, timeline and table are equal; curves have the same extremes.

    A large trace is not in memory at once.
    """
    *_, (last_ns, *_) = recorded(REFERENCE, TURNS)
    files = {}
    for size, rows in BULKY_ROWS.items():
        (tmp_path / size).mkdir()
        bulk = bulky(tmp_path / "bulk.mcap", last_ns, rows)
        files[size] = repeated(tmp_path / size / "run.mcap", bulk)
    whole = report_of(files["small"], tmp_path / "small")
    at_once = []
    read_all = Trace.read_all

    def counted(self: Trace, *args: Any, **more: Any) -> dict[str, Table]:
        tables = read_all(self, *args, **more)
        at_once.append(sum(len(table) * len(table.columns) for table in tables.values()))
        return tables

    monkeypatch.setattr(Trace, "read_all", counted)
    thin = report_of(files["large"], tmp_path / "large")
    assert max(at_once, default=0) < 1_000_000  # it has five times as many
    assert without_bulk(thin.text) == without_bulk(whole.text)
    assert "/plant/output eta.x m 13050 " in whole.words
    left_out = "<h3>Not shown</h3>"
    assert (left_out in thin.text) == (left_out in whole.text)
    assert thin.figures["span"] == whole.figures["span"]
    for key, chart in whole.charts.items():
        for a, b in zip(chart.curves, thin.charts[key].curves, strict=True):
            assert (a.label, b.t[0], b.t[-1]) == (b.label, a.t[0], a.t[-1])
            assert np.nanmax(a.values) == np.nanmax(b.values)
            assert np.nanmin(a.values) == np.nanmin(b.values)
    of_topics = 0
    for chart in thin.charts.values():
        topic = "/" + chart.title.replace(" ", "/")
        if topic not in Trace(files["large"]).topics:
            continue
        table = Trace(files["large"]).read(topic)
        for curve in chart.curves:  # each point is one of the trace
            after = np.clip(np.searchsorted(table.delivered, curve.t), 1, len(table) - 1)
            nearer = curve.t - table.delivered[after - 1] < table.delivered[after] - curve.t
            assert curve.packed[1] == packed_values(table[curve.label][after - nearer])
            of_topics += 1
    assert of_topics > 5
