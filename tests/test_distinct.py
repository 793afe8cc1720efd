"""Distinct values, as NumPy finds them."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.core import distinct


@pytest.mark.parametrize(
    "values", [[], [3], [2, 2], [5, 1, 5, 3, 1], [[2, 1], [1, 0]], [2**62, -(2**62), 0]], ids=str
)
@pytest.mark.parametrize("kind", [np.int64, np.float64])
def test_distinct_values_are_those_of_numpy(values: list[int], kind: type) -> None:
    given = np.array(values, kind)
    found = distinct(given)
    assert found.dtype == given.dtype
    assert found.tolist() == np.unique(given).tolist()
