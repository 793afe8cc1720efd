"""Each algorithm and policy converges with its documented order, over five halvings."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.orders import CASES, HALVINGS, Fmus, errors, orders_fmus, slopes

EXPECTED = {
    "jacobi, hold": 1.0,
    "gauss-seidel, hold": 1.0,
    "jacobi, linear": 2.0,
    "transport delay, hold": 1.0,
    "transport delay, midpoint": 2.0,
    "gain between delays, hold": 1.0,
    "gain between delays, midpoint": 2.0,
    "two masses, hold": 1.0,
    "two masses, linear": 2.0,
}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    return orders_fmus(tmp_path_factory.mktemp("orders"))


@pytest.mark.parametrize("name", EXPECTED)
def test_order_over_five_halvings(fmus: Fmus, name: str) -> None:
    found = errors(fmus, CASES[name])
    assert len(found) == len(HALVINGS) == 6
    assert slopes(found) == pytest.approx([EXPECTED[name]] * 5, abs=0.2)
    assert slopes(found)[-1] == pytest.approx(EXPECTED[name], abs=0.03)


def test_event_aligned_packets_are_exact_whatever_the_step(fmus: Fmus) -> None:
    assert np.max(errors(fmus, CASES["packets, event-aligned"])) < 1e-13


def test_gauss_seidel_is_more_accurate_than_jacobi(fmus: Fmus) -> None:
    one, other = (errors(fmus, CASES[f"{name}, hold"]) for name in ("gauss-seidel", "jacobi"))
    assert (np.array(one) < 0.2 * np.array(other)).all()
