"""Each algorithm and policy converges with its documented order, over five halvings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.orders import CASES, HALVINGS, errors, slopes
from scalar import scalar_fmu

EXPECTED = {
    "jacobi, hold": 1.0,
    "gauss-seidel, hold": 1.0,
    "jacobi, linear": 2.0,
    "transport delay, hold": 1.0,
    "transport delay, midpoint": 2.0,
}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


@pytest.mark.parametrize("name", EXPECTED)
def test_order_over_five_halvings(fmu: Path, name: str) -> None:
    found = errors(fmu, CASES[name])
    assert len(found) == len(HALVINGS) == 6
    assert slopes(found) == pytest.approx([EXPECTED[name]] * 5, abs=0.2)
    assert slopes(found)[-1] == pytest.approx(EXPECTED[name], abs=0.03)


def test_event_aligned_packets_are_exact_whatever_the_step(fmu: Path) -> None:
    assert np.max(errors(fmu, CASES["packets, event-aligned"])) < 1e-13


def test_gauss_seidel_is_more_accurate_than_jacobi(fmu: Path) -> None:
    one, other = (errors(fmu, CASES[f"{name}, hold"]) for name in ("gauss-seidel", "jacobi"))
    assert (np.array(one) < 0.2 * np.array(other)).all()
