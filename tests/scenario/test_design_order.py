"""An order in [design] must prove what a link needs: every age up to the delay."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.core.errors import NotAchievableError
from cosim.models.delay_system import Delay, DelaySystem
from cosim.scenario.gain import Problem, solve


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
