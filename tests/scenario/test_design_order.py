"""An order in [design]: what it proves must fit what a link does."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.core.errors import NotAchievableError
from cosim.models.delay_system import Delay, DelaySystem
from cosim.scenario.gain import Problem, solve


def link(*, any_age: bool) -> Problem:
    """A mass that is steered over a second."""
    delay = Delay(1.0, np.zeros((2, 2)), feedback=True, any_age=any_age)
    D2 = [[0], [0.1]]
    system = DelaySystem(
        [[0, 1], [0, -0.1]], [[0], [1]], [[0], [1]], [[1, 0], [0, 0]], D2=D2, delays=[delay]
    )
    return Problem(system, (-0.5,), (1.0,), None)


def test_one_constant_age_does_not_fit_a_link() -> None:
    """At the least gamma of order 1 a constant delay is proved at exactly its length: refused."""
    with pytest.raises(NotAchievableError, match="exactly one age"):
        solve(link(any_age=False), None, 1)


def test_a_delay_of_any_age_does() -> None:
    """There the order is 0 in all cases, and every age up to the delay is covered."""
    found = solve(link(any_age=True), None, 1)
    assert found.covers_smaller_delays
    assert found.order == 1
