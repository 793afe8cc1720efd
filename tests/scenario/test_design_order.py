"""An order in [design] must prove what a link needs: every age up to the delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.core import NotAchievableError
from cosim.models import Delay, DelaySystem
from cosim.scenario import Problem
from cosim.scenario.gain import solve
from cosim.scenario.guarantee.claim import covers_plant_delays


def link(*, any_age: bool) -> Problem:
    """A mass controlled over a delay of one second."""
    delay = Delay(1.0, np.zeros((2, 2)), feedback=True, any_age=any_age)
    D2 = [[0], [0.1]]
    system = DelaySystem(
        [[0, 1], [0, -0.1]], [[0], [1]], [[0], [1]], [[1, 0], [0, 0]], D2=D2, delays=[delay]
    )
    return Problem(system, (-0.5,), (1.0,), None)


def test_order_that_proves_one_age_only_is_refused() -> None:
    """At the least gamma of order 1 a constant delay is proved at exactly its length: refused."""
    with pytest.raises(NotAchievableError, match="exactly one age"):
        solve(link(any_age=False), None, 1)


def test_delay_of_any_age_is_designed_at_order_0() -> None:
    """There the order is 0 in all cases, and every age up to the delay is covered."""
    found = solve(link(any_age=True), None, 1)
    assert found.covers_smaller_delays
    assert found.order == 1


def test_a_constant_delay_in_the_plant_may_be_proved_exactly() -> None:
    """Beside feedback of any age; a run is then covered with that delay, not with a shorter one."""
    inner, late = Delay(0.4, [[0, 0], [0, -0.2]]), link(any_age=True).system
    system = replace(late, delays=(inner, *late.delays))
    found = solve(Problem(system, None, None, None), [[-0.2, -0.6]], 1)
    claimed = dict.fromkeys(["delay.d"], 0.4)
    for d, covered in ((0.4, True), (0.3, False), (0.5, False)):
        apart = list(covers_plant_delays(found, claimed, {"delay.d": d}))
        assert (apart == []) is covered
    loose = solve(Problem(system, None, None, None), [[-0.2, -0.6]], 0)
    assert list(covers_plant_delays(loose, claimed, {"delay.d": 0.3})) == []
