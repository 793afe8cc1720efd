"""kill -9 at random moments: never more than the flush interval is lost."""

from __future__ import annotations

import pytest
from benchmarks.kill import INTERVAL_S, MODES, kills
from shared import share_of


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(4)))
def test_killed_process_loses_at_most_the_interval(part: int) -> None:
    """Every kept row is right and in its place: the benchmark looks at each."""
    found = kills(range(10 * part, 10 * (part + 1)))
    assert {loss.mode for loss in found} == set(MODES)
    assert max(loss.seconds for loss in found) <= INTERVAL_S
    # a row that is in the file before it could be told of is no loss
    assert all(loss.kept > 0 for loss in found if loss.seconds == 0)
    assert any(loss.kept < loss.written for loss in found)
