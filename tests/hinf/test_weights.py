"""Weights of the rows of z: what they do to D, D1, D2 and so to gamma."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import DelaySystem, design
from cosim.hinf.problem import weighted
from cosim.models import paper_example


def test_every_row_has_its_own_factor() -> None:
    """D, D1 and D2 by rows; nothing else moves."""
    system = paper_example.system()
    other = weighted(system, [0.5, 4.0])
    for name in ("D", "D1", "D2"):
        np.testing.assert_array_equal(
            getattr(other, name), np.diag([0.5, 4.0]) @ getattr(system, name)
        )
    for name in ("A", "B", "C", "E", "H"):
        np.testing.assert_array_equal(getattr(other, name), getattr(system, name))
    assert other.delays == system.delays or other.delays[0].d == system.delays[0].d


def test_one_weight_for_all_is_a_factor_of_gamma() -> None:
    """z times 3: the least gamma is three times as large, to the accuracy of a solve."""
    system = paper_example.system()
    one = design(system, (0.6,), (0.2,)).gamma
    three = design(weighted(system, [3.0, 3.0]), (0.6,), (0.2,)).gamma
    assert one is not None
    assert three == pytest.approx(3 * one, rel=1e-4)


@pytest.mark.parametrize(
    "weights", [[1.0], [1.0, 2.0, 3.0], [1.0, 0.0], [1.0, -1.0], [1.0, np.inf]]
)
def test_invalid_weights_are_refused(weights: list[float]) -> None:
    """One positive number per row of z."""
    with pytest.raises(InputError, match="weight"):
        weighted(paper_example.system(), weights)


def test_a_system_without_z_has_no_weights() -> None:
    """The message says so."""
    with pytest.raises(InputError, match="no z"):
        weighted(DelaySystem([[-1.0]]), [1.0])
