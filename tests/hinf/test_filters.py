"""Weights that depend on frequency: held to the product of transfer functions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, design
from cosim.hinf.delay_lti import close
from cosim.hinf.problem import Filter, filtered, system_from_toml

FILE = """
[system]
A = [[-0.5, 1.0], [0.0, -1.0]]
B = [[0.0], [1.0]]
C = [[1.0], [0.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D1 = [[0.1], [0.0]]
D2 = [[0.0], [0.5]]
{more}
[[system.delays]]
d = 0.3
feedback = true
[weights.z]
numerators = [[1.0, 2.0], [3.0]]
denominators = [[1.0, 0.5], [1.0]]
[weights.w]
A = [[-0.2]]
B = [[0.2]]
C = [[1.0]]
"""


def plant() -> DelaySystem:
    """Give the system of the file without its filters."""
    return DelaySystem(
        [[-0.5, 1], [0, -1]],
        [[0], [1]],
        [[1], [0]],
        [[1, 0], [0, 0]],
        [[0.1], [0]],
        [[0], [0.5]],
        delays=[Delay(0.3, np.zeros((2, 2)), feedback=True)],
    )


def test_the_weighted_loop_is_the_product_of_the_transfer_functions() -> None:
    """W_z G W_w at many frequencies, feedback over a delay included."""
    system = system_from_toml(FILE.format(more=""), where="f.toml", name="f").system
    K = np.array([[-0.4, -0.3]])
    whole = close(system, np.hstack([K, np.zeros((1, len(system.A) - 2))]))
    omega = np.geomspace(1e-2, 1e2, 60)
    found = whole.transfer(omega)
    s = 1j * omega
    own = close(plant(), K).transfer(omega)
    top = (s + 2) / (s + 0.5) * own[:, 0, 0] * 0.2 / (s + 0.2)
    bottom = 3 * own[:, 1, 0] * 0.2 / (s + 0.2)
    assert np.allclose(found[:, 0, 0], top, rtol=1e-12)
    assert np.allclose(found[:, 1, 0], bottom, rtol=1e-12)


def test_a_design_does_not_feed_back_the_states_of_filters() -> None:
    """Its certified gamma bounds the weighted gain, and K is zero on the filters' states."""
    system = system_from_toml(FILE.format(more=""), where="f.toml", name="f").system
    found = design(system)
    assert found.K.shape == (1, 4)
    assert not found.K[0, 2:].any()
    gains = np.linalg.norm(
        close(plant(), found.K[:, :2]).transfer(s := np.geomspace(1e-3, 1e2, 2000))
        * (
            np.array([(1j * s + 2) / (1j * s + 0.5), 3 + 0j * s]).T
            * (0.2 / (1j * s + 0.2))[:, None]
        )[:, :, None],
        axis=(1, 2),
    )
    assert gains.max() <= found.gamma < 1.1 * gains.max()


def test_row_weights_filters_and_integrals_come_in_this_order() -> None:
    """The plant that is packed as an FMU has none of their states."""
    more = "weights = [2.0, 1.0]\n[system.integral]\nof = [1]\n"
    named = system_from_toml(FILE.format(more=more), where="f.toml", name="f")
    assert len(named.system.A) == 5
    assert named.system.integrals == 1
    assert named.plant is not None
    assert named.plant.D.tolist() == [[2, 0], [0, 0]]
    assert len(named.plant.A) == 2
    assert named.system.A[2:4, 0].tolist() == [0.0, 2.0]  # of the filter of w, then of z


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Filter.from_coefficients([([1.0, 0.0], [1.0])], where="weights.z"), "proper"),
        (lambda: Filter.from_coefficients([([1.0], [1.0, 0.0])], where="weights.z"), "not stable"),
        (lambda: Filter.from_matrices([[-1]], [[1], [1]], [[1]], where="f"), "not a filter"),
        (
            lambda: filtered(
                plant(), z=Filter.from_matrices([[-1]], [[1]], [[1]], where="weights.z")
            ),
            "2 inputs",
        ),
        (
            lambda: system_from_toml(
                FILE.replace("[1.0, 0.5]", "1").format(more=""), where="f", name="f"
            ),
            "list",
        ),
    ],
)
def test_what_is_no_weight_is_refused(make: Any, word: str) -> None:
    """Each refusal names what was expected."""
    with pytest.raises(InputError) as caught:
        make()
    assert word in str(caught.value)
