"""Designs: certified, next to what does not use the LMI, and refused where they cannot be had."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim.core import InputError, NotAchievableError
from cosim.hinf import analyse, auv_system, check_certificate, design, greatest_delay
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2
from cosim.models import Delay, DelaySystem, paper_example


def test_section_5_is_certified_close_above_its_least_gamma() -> None:
    """5.0132 at k1 = .6, k2 = .2, and the exact norm below it; the proof holds from its JSON."""
    found = design(paper_example.system(), (0.6,), (0.2,), order=None)
    assert found.gamma is not None
    assert found.least_gamma is not None
    assert found.exact_norm is not None
    assert found.least_gamma < found.gamma < found.least_gamma * (1 + 1e-4)
    assert found.gamma == pytest.approx(5.0132, abs=1e-3)
    assert 5.0 <= found.exact_norm < found.gamma
    assert check_certificate(found.certificate).valid


def test_the_printed_gain_is_analysed_as_it_is() -> None:
    """exact norm 5.0276 at 22.9 rad/s, rightmost root -5.138; certified above."""
    found = design(paper_example.system(), (0.6,), (0.2,), gain=[list(paper_example.PRINTED_K)])
    assert found.K.tolist() == [list(paper_example.PRINTED_K)]
    assert found.exact_norm == pytest.approx(5.0276, abs=1e-4)
    assert found.norm_frequency == pytest.approx(22.9, abs=0.1)
    assert found.abscissa == pytest.approx(-5.138, abs=1e-3)
    assert found.gamma is not None
    assert found.gamma > found.exact_norm


def test_the_vehicle_over_its_link() -> None:
    """Eight states, two delays of any age: certified, no more than 3.4188."""
    found = design(auv_system(), DEFAULT_K1, DEFAULT_K2)
    assert found.gamma is not None
    assert found.exact_norm is not None
    assert found.exact_norm < found.gamma <= 3.4188
    assert found.abscissa < 0
    assert check_certificate(found.certificate).valid


def test_two_delays_are_searched_at_once() -> None:
    """Four scalars: certified, below the start's least gamma, above the exact norm."""
    system = DelaySystem(
        [[0.0, 1.0], [-1.0, -0.5]],
        [[0.0], [1.0]],
        [[0.0], [1.0]],
        [[1.0, 0.0], [0.0, 0.0]],
        None,
        [[0.0], [0.3]],
        delays=[
            Delay(0.2, [[0.0, 0.0], [0.1, -0.1]]),
            Delay(0.4, np.zeros((2, 2)), feedback=True, any_age=True),
        ],
    )
    k1, k2 = (-1.0, -1.0), (1.0, 1.0)
    start = design(system, k1, k2, order=None)
    found = design(system, k1, k2, order=None, search=True)
    assert start.gamma is not None
    assert found.gamma is not None
    assert found.exact_norm is not None
    assert found.exact_norm < found.gamma < 0.99 * start.gamma
    assert check_certificate(found.certificate).valid


def test_stability_alone_where_there_is_nothing_to_bound() -> None:
    """A published benchmark, stable to 6.1726, without w and z: certified at d = 3."""
    late = [Delay(3.0, [[-1, 0], [-1, -1]])]
    system = DelaySystem([[-2.0, 0.0], [0.0, -0.9]], [[0.0], [0.0]], delays=late)
    found = design(system, (-0.1,), (0.2,), order=None, search=False)
    assert found.gamma is None
    assert check_certificate(found.certificate).valid


def test_unachievable_designs_name_their_cause() -> None:
    """gamma <= ||D1|| = 5, gamma below the least, k2 = 0, what no input reaches."""
    system = paper_example.system()
    with pytest.raises(NotAchievableError, match="D1"):
        design(system, (0.6,), (0.2,), gamma=5.0, alternatives=False)
    with pytest.raises(NotAchievableError, match="cannot be reached"):
        design(system, (0.6,), (0.2,), gamma=5.01, order=None, alternatives=False)
    with pytest.raises(InputError, match="k2"):
        design(system, (0.6,), (0.0,))
    uncontrollable = DelaySystem(
        [[1.0, 0.0], [0.0, -1.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), delays=[]
    )
    with pytest.raises(NotAchievableError, match="no input reaches"):
        design(uncontrollable, (), (), alternatives=False)


def _without_B() -> DelaySystem:
    return DelaySystem(
        [[-5.0, 0.0], [6.0, -10.0]], C=[[4.0], [3.0]], D=np.eye(2), delays=[Delay(0.3, np.eye(2))]
    )


@pytest.mark.parametrize("asked", [{}, {"search": True}, {"order": 1}, {"decay": 1.0}], ids=str)
def test_a_design_without_b_is_refused(asked: dict[str, Any]) -> None:
    """No control, no gain: what was analysed until now under the name of a design."""
    with pytest.raises(InputError, match=r"B is missing(?s:.)*2 rows(?s:.)*analyse") as refused:
        design(_without_B(), (0.6,), (0.2,), **asked)
    assert (refused.value.where, refused.value.got) == ("B", "no B")


@pytest.mark.parametrize("order", [None, 1])
def test_a_greatest_delay_without_b_is_refused(order: int | None) -> None:
    """A gain is designed at each delay, so there must be one."""
    with pytest.raises(InputError, match="B is missing"):
        greatest_delay(_without_B(), 6.0, (0.6,), (0.2,), order=order)


def test_an_analysis_without_b_takes_no_gain() -> None:
    """As it is, it is analysed; a gain acts on nothing, and it is not its shape that is wrong."""
    assert analyse(_without_B()).certified
    with pytest.raises(InputError, match=r"acts on nothing.*B is missing"):
        analyse(_without_B(), [[1.0, 2.0]])
