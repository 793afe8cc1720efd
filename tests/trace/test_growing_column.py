"""A column that grows part by part is the parts one after another, whatever was expected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.trace import Signal, Trace, TraceWriter

ROWS, ABSENT = 130, 10
KINDS = [
    Signal("x"),
    Signal("n", kind="int"),
    Signal("word", kind="string"),
    Signal("long", kind="string"),
]
LONG = "x" * 100_000
"""Rows of 4 MiB together are decoded at once: here some forty."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Long rows, the last of them without a word."""
    path = tmp_path_factory.mktemp("grown") / "a.mcap"
    with TraceWriter(path, run={}) as writer:
        topic = writer.add_topic("/a/output", KINDS, schema_name="t.A")
        for k in range(ROWS):
            word = None if k >= ROWS - ABSENT else f"w{k}"
            writer.write(topic, k, [k / 7, -k, word, f"{LONG}{k}"])
        writer.finish({})
    return path


@pytest.mark.parametrize(
    ("first", "last", "window"),
    [
        (0, ROWS - 1, {}),
        (0, ROWS - 1, {"start": 0.0}),
        (30, ROWS - 1, {"start": 30e-9}),
        (0, 100, {"end": 100e-9}),
        (50, 51, {"start": 50e-9, "end": 51e-9}),
    ],
)
def test_column_is_its_parts_whatever_was_expected(
    path: Path, first: int, last: int, window: dict[str, float]
) -> None:
    """The number of rows is known of a whole topic, and not of a window of time.

    Where a value is absent is known of each part by itself.
    """
    table = Trace(path).read("/a/output", **window)
    rows = range(first, last + 1)
    assert table["x"].tolist() == [k / 7 for k in rows]
    assert table["n"].tolist() == [-k for k in rows]
    assert (table["x"].dtype, table["n"].dtype) == (np.float64, np.int64)
    assert table["long"].tolist() == [f"{LONG}{k}" for k in rows]
    there = [k < ROWS - ABSENT for k in rows]
    assert table["word"].tolist() == [
        f"w{k}" if t else "" for k, t in zip(rows, there, strict=True)
    ]
    assert table.present["word"].tolist() == there
    assert table.present["x"].all()
