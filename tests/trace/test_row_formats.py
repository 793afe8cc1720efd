"""Rows of fixed width (format 2), and files whose integers have as many bytes as they need (1)."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from content_hashes import in_format_1
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_files import payloads_of, schemas_of, type_of

from cosim.core import InputError
from cosim.trace import (
    Rows,
    Signal,
    Trace,
    TraceWriter,
    begins_with,
    content_hash,
    describe,
    diff,
    same_content,
)

SIGNALS = [
    Signal("text", kind="string"),
    Signal("n", kind="int", unit="1"),
    Signal("many", kind="uint"),
    Signal("on", kind="bool"),
    Signal("x", unit="m"),
    Signal("end", kind="string"),
]
VALUES: list[list[Any]] = [
    ["", 0, 0, False, 0.0, "a"],
    ["lost", -(2**63), 2**64 - 1, True, -0.0, ""],
    ["lost", 127, 128, True, np.inf, "ä" * 100],
    ["x" * 200, 2**63 - 1, 1, False, np.nan, "a"],
    [None, 1, None, None, None, "a"],
]


def written(path: Path, values: list[list[Any]], *, at_once: bool = True, **run: str) -> Path:
    """These rows, and rows of numbers alone, in the format of today."""
    with TraceWriter(path, run={"scenario": "s", **run}, content_hash=True) as writer:
        mixed = writer.add_topic("/a/output", SIGNALS, schema_name="cosim.a.Output")
        plain = writer.add_topic("/b/output", SIGNALS[1:5], schema_name="cosim.b.Output")
        numbers = [row[1:5] for row in values if None not in row]
        if at_once:
            writer.write_rows(
                [
                    Rows(topic, np.arange(len(rows)) * 10, rows, np.arange(len(rows)))
                    for topic, rows in ((mixed, values), (plain, numbers))
                ]
            )
        for topic, rows in ((mixed, values), (plain, numbers)) if not at_once else ():
            for k, row in enumerate(rows):
                writer.write(topic, 10 * k, row, publish_time_ns=k)
        return writer.finish({"status": "finished"})


def test_numbers_of_every_kind_have_one_width(tmp_path: Path) -> None:
    """Tags of one byte and values of eight, one of a boolean; protobuf reads what was written."""
    path = written(tmp_path / "a.mcap", VALUES)
    assert {len(payload) for payload in payloads_of(path, "/b/output")} == {3 * 9 + 2}
    message = type_of(path, "/b/output")
    for payload, row in zip(payloads_of(path, "/b/output"), VALUES, strict=False):
        found = message.FromString(payload)
        assert repr([found.n, found.many, found.on, found.x]) == repr([*row[1:4], float(row[4])])


def test_rows_one_by_one_are_those_written_together(tmp_path: Path) -> None:
    """Texts between numbers and absent values included."""
    one = written(tmp_path / "one.mcap", VALUES, at_once=False)
    many = written(tmp_path / "many.mcap", VALUES)
    for topic in ("/a/output", "/b/output"):
        assert payloads_of(one, topic) == payloads_of(many, topic)
    assert content_hash(one) == content_hash(many)


def test_rows_of_one_instant_stay_in_the_order_given(tmp_path: Path) -> None:
    """Whatever their sizes."""
    words = ["aaa", "", "bbb", "c", "", "dd"]
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/a", [Signal("s", kind="string")], schema_name="t.A")
        times = np.array([0, 0, 0, 0, 5, 5])
        writer.write_rows([Rows(topic, times, [[word] for word in words])])
        path = writer.finish({})
    assert Trace(path).read("/a")["s"].tolist() == words


def test_a_file_of_format_1_keeps_its_hash_and_has_the_content_of_one_of_format_2(
    tmp_path: Path,
) -> None:
    path = written(tmp_path / "now.mcap", VALUES)
    earlier = in_format_1(path, tmp_path / "then.mcap")
    now, then = Trace(path), Trace(earlier)
    assert (now.row_format, then.row_format) == (2, 1)
    assert (now.content_hash_version, then.content_hash_version) == (3, 2)
    assert now.run == then.run == {"scenario": "s"}
    assert payloads_of(path, "/b/output") != payloads_of(earlier, "/b/output")
    assert content_hash(path) != content_hash(earlier)
    assert same_content(now, then)
    assert same_content(then, now)
    assert begins_with(now, then)
    assert diff(path, earlier).identical


@pytest.mark.parametrize(
    ("row", "column", "value"),
    [(0, 1, 1), (1, 4, 0.0), (2, 3, False), (2, 0, "late"), (4, 2, 0), (3, 5, "b")],
)
def test_one_other_value_is_another_content(
    tmp_path: Path, row: int, column: int, value: Any
) -> None:
    """A zero of another sign, and a zero where no value was, included."""
    changed = [list(each) for each in VALUES]
    changed[row][column] = value
    path = written(tmp_path / "a.mcap", VALUES)
    other = in_format_1(written(tmp_path / "b.mcap", changed), tmp_path / "c.mcap")
    assert not same_content(Trace(path), Trace(other))
    assert not same_content(Trace(other), Trace(path))
    assert not begins_with(Trace(path), Trace(other))
    assert not diff(path, other).identical


def test_the_first_rows_of_a_file_are_its_beginning_in_either_format(tmp_path: Path) -> None:
    path = written(tmp_path / "whole.mcap", VALUES)
    part = in_format_1(written(tmp_path / "b.mcap", VALUES[:3]), tmp_path / "part.mcap")
    assert begins_with(Trace(path), Trace(part))
    assert not begins_with(Trace(part), Trace(path))
    assert not same_content(Trace(path), Trace(part))


def test_rows_of_an_unknown_format_are_read_and_have_no_hash(tmp_path: Path) -> None:
    """A later version may write them; the reader says who knows their hash."""
    path = written(tmp_path / "a.mcap", VALUES)
    later = tmp_path / "later.mcap"
    with path.open("rb") as source, later.open("wb") as stream:
        reader, writer = make_reader(source), Writer(stream)
        writer.start("", "auv-cosim")
        (run, result) = reader.iter_metadata()
        writer.add_metadata(run.name, {**run.metadata, "row_format": "3"})
        for topic, schema in schemas_of(path).items():
            number = writer.register_schema(schema.name, "protobuf", schema.data)
            channel = writer.register_channel(topic, "protobuf", number, {})
            for k, payload in enumerate(payloads_of(path, topic)):
                writer.add_message(channel, k, payload, k)
        writer.add_metadata(result.name, result.metadata)
        writer.finish()
    assert Trace(later).read("/b/output")["n"].tolist() == [row[1] for row in VALUES[:4]]
    for asked in (lambda: content_hash(later), lambda: diff(path, later)):
        with pytest.raises(InputError, match="another format") as caught:
            asked()
        assert "newer" in str(caught.value.hint)
    found = describe(later)
    assert (found["content_hash"], found["content_hash_version"]) == (None, None)


def test_signals_of_both_formats_are_the_same(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", VALUES)
    earlier = in_format_1(path, tmp_path / "b.mcap")
    for topic in ("/a/output", "/b/output"):
        one, other = Trace(path).topics[topic].signals, Trace(earlier).topics[topic].signals
        assert [*map(dataclasses.asdict, one)] == [*map(dataclasses.asdict, other)]
        now, then = Trace(path).read(topic), Trace(earlier).read(topic)
        for signal in one:
            assert repr(now[signal.name].tolist()) == repr(then[signal.name].tolist())
