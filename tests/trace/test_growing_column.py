"""A column that grows part by part is the parts one after another, whatever was expected."""

import zlib

import numpy as np
import pytest

from cosim.trace.file.checksum import crc32
from cosim.trace.tables.growing import GrowingColumn


@pytest.mark.parametrize("expected", [0, 1, 7, 8, 100])
def test_column_is_its_parts_whatever_was_expected(expected: int) -> None:
    column = GrowingColumn(np.float64, expected)
    for values in ([1.0, 2.0], [], [3], [4.5] * 5):
        column.extend(np.array(values), None)
    assert column.values.tolist() == [1.0, 2.0, 3.0, *[4.5] * 5]
    assert column.values.dtype == np.float64
    assert column.present is None


def test_presence_of_a_part_is_its_own() -> None:
    column = GrowingColumn(object, 0)
    column.extend(["a", "b"], None)
    column.extend(["c"], np.array([False]))
    assert column.values.tolist() == ["a", "b", "c"]
    present = column.present
    assert present is not None
    assert present.tolist() == [True, True, False]


def test_checksum_is_that_of_zlib() -> None:
    data = np.random.default_rng(1).bytes(100_001)
    assert crc32(data) == zlib.crc32(data)
    assert crc32(memoryview(data)[7:], crc32(data[:7])) == zlib.crc32(data)
