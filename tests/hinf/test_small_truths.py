"""Verdicts on loops at the edge, and remarks on gains out of proportion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim.hinf import Delay, DelaySystem, analyse
from cosim.hinf.delay_lti import verdict_of
from cosim.hinf.synthesis import gain_remark

OSCILLATOR = [[0.0, 1.0], [-1.0, 0.0]]
CHAIN = [[0.0, 1.0], [0.0, 0.0]]
AT_THE_EDGE: dict[str, dict[str, Any]] = {
    "zero": {"A": [[0.0]]},
    "two zero roots": {"A": np.zeros((2, 2))},
    "a chain of integrators": {"A": CHAIN},
    "an oscillator": {"A": OSCILLATOR},
    "stable beside an integrator": {"A": np.diag([-1.0, 0.0])},
    "a late term that is zero": {"A": [[0.0]], "delays": [Delay(1.0, [[0.0]])]},
    "a root at 0 by the sum alone": {"A": [[-1.0]], "delays": [Delay(0.5, [[1.0]])]},
    "tiny": {"A": np.multiply(1e-200, OSCILLATOR)},
    "huge": {"A": np.multiply(1e150, OSCILLATOR)},
}
OUTPUTS: list[dict[str, Any]] = [{}, {"C": 1, "D": 1}, {"C": 0, "D": 1}, {"C": 1, "D": 0}]


@pytest.mark.parametrize("name", AT_THE_EDGE)
def test_a_root_on_the_axis_is_undecided(name: str) -> None:
    """No error, no proof and no claim of instability, whatever w and z are."""
    given = AT_THE_EDGE[name]
    n = len(given["A"])
    for output in OUTPUTS:
        size = {"C": (n, 1), "D": (1, n)}
        system = DelaySystem(**given, **{k: np.full(size[k], float(x)) for k, x in output.items()})
        found = analyse(system)
        assert (found.verdict, found.certified, found.exact_norm) == ("undecided", False, None)
        assert found.reason


def test_unstable_is_proved_and_zero_is_exact() -> None:
    """A root right of the axis is enclosed, a double one and one of a chain too, others never."""

    def verdict(A: Any, *delays: Delay) -> str:
        return analyse(DelaySystem(A, delays=delays)).verdict

    unstable: list[tuple[Any, ...]] = [
        ([[1e-9]],),
        ([[0.0]], Delay(1.6, [[-1.0]])),  # pi/2 < 1.6
        (np.diag([2.0, 2.0]),),
        (np.diag([1.0, 2.0]),),
        (np.diag([0.0, 1.0]),),
        (1e-3 * np.eye(3) + np.eye(3, k=1),),
        ([[0.0, 1.0], [1e-9, 0.0]],),
    ]
    for case in unstable:
        assert verdict(*case) == "unstable"
    assert verdict([[0.0]], Delay(1.57, [[-1.0]])) == "certified"
    assert verdict(OSCILLATOR) == "undecided"
    none = np.zeros((0, 1))
    for late, exactly in ((0.3, True), (np.nextafter(0.3, 1), False)):
        system = DelaySystem([[-0.3]], delays=[Delay(1.0, [[late]])])
        assert ("is 0, exactly" in verdict_of(system, none, 0.0)[1]) == exactly


FAR = [(1e-200, 0.0), (1e-200, 0.5), (1e-30, 0.5), (1e30, 0.0), (1e150, 0.0)]


@pytest.mark.parametrize(("scale", "late"), FAR)
def test_numbers_far_from_one_end_in_an_answer(scale: float, late: float) -> None:
    """A verdict, and no overflow."""
    delays = [Delay(late, [[-scale]])] if late else []
    system = DelaySystem([[-scale]], C=[[1.0]], D=[[1.0]], delays=delays)
    assert analyse(system).verdict in {"certified", "undecided"}


def plant(*, weight: float = 0.0, time: float = 1.0, units: float = 1.0) -> DelaySystem:
    """Of the second order, in other units of time and state; u in z by `weight`."""
    T = np.diag([1.0, units])
    A = T @ np.array([[0.0, 1.0], [1.0, -1.0]]) @ np.linalg.inv(T) / time
    D = np.array([[1.0, 0.0], [0.0, 0.0]]) @ np.linalg.inv(T)
    return DelaySystem(A, T @ [[0.0], [1.0]] / time, T @ [[1.0], [1.0]], D, D2=[[0.0], [weight]])


@pytest.mark.parametrize(("time", "units"), [(1.0, 1.0), (1e-4, 1.0), (1e4, 1e3)])
def test_a_gain_out_of_proportion_is_remarked_in_any_units(time: float, units: float) -> None:
    """The same loop: the same answer; the cure names the limit and the weight."""
    for gain, remarked in (([[-3.0, -2.0]], False), ([[-1.2e11, -1.7e9]], True)):
        K = np.array(gain) @ np.linalg.inv(np.diag([1.0, units]))
        remark = gain_remark(plant(time=time, units=units), K)
        assert (remark is not None) == remarked
        if remark is not None:
            assert "gain limit" in remark
            assert "z does not contain every input" in remark
    priced = gain_remark(plant(weight=1e-9), np.array([[-1.2e11, -1.7e9]]))
    assert priced is not None
    assert "larger weight" in priced
    assert gain_remark(DelaySystem([[0.0]], [[1.0]]), np.array([[-5.0]])) is None
    assert gain_remark(DelaySystem([[0.0]], [[1.0]]), np.array([[-1.5e10]])) is not None
