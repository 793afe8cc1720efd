"""Limit cycle, steady saturation, decay: told apart on commands that were made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim.scenario.limits import saturation

T = np.arange(0.0, 100.0, 0.1)
LIMIT = 10.0


def flown(command: np.ndarray, times: np.ndarray = T, limit: float | None = None) -> Any:
    """A run of one controller with one limited force."""
    ports = {
        "force.x": SimpleNamespace(start=0.0),
        "limit.force": SimpleNamespace(start=LIMIT),
    }
    component = SimpleNamespace(
        description=SimpleNamespace(ports=ports),
        parameters={} if limit is None else {"limit.force": limit},
    )
    return SimpleNamespace(
        points_ns=np.round(times * 1e9).astype(np.int64),
        stations=(SimpleNamespace(name="controller", component=component),),
        signal=lambda _component, _variable: command,
    )


def clipped(signal: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.clip(signal, -LIMIT, LIMIT)
    return result


@pytest.mark.parametrize(
    ("command", "cycle"),
    [
        (clipped(1000.0 * np.sin(T)), True),
        (clipped(1.3 * LIMIT * np.sin(T)), False),
        (np.full(T.size, LIMIT), False),
        (clipped(1000.0 * np.sin(T) * np.exp(-T / 5.0)), False),
        (0.9999 * LIMIT * np.sign(np.sin(T)), False),
        (np.where(T < 75.0, clipped(1000.0 * np.sin(T)), 0.0), False),
        (np.where(T < 75.0, 0.0, clipped(1000.0 * np.sin(T))), True),
        (np.where(T < 90.0, LIMIT, -LIMIT), False),
        (np.zeros(T.size), False),
    ],
    ids=[
        "from limit to limit",
        "touches the limits less than half of the time",
        "stands at one limit",
        "decays",
        "just below the limits",
        "ended before the last quarter",
        "began in the last quarter",
        "one reversal",
        "nothing",
    ],
)
def test_limit_cycle_is_told_from_saturation(command: np.ndarray, *, cycle: bool) -> None:
    """A limit cycle goes to and fro between the limits, most of the last quarter."""
    found = saturation(flown(command), "controller")
    assert found is not None
    assert found.limit_cycle is cycle


def test_fraction_is_of_time_not_of_points() -> None:
    """One second at the limit in a hundred counts one percent, in one point or in a thousand."""
    times = np.concatenate([np.linspace(0.0, 1.0, 1001)[:-1], [1.0, 100.0]])
    command = np.where(times < 1.0, LIMIT, 0.0)
    found = saturation(flown(command, times), "controller")
    assert found is not None
    assert found.fraction == pytest.approx(0.01, rel=1e-12)
    assert found.largest == {"force.x": LIMIT}


def test_limit_that_the_scenario_sets_counts() -> None:
    """The bound is the parameter of the run, not the FMU's default."""
    found = saturation(flown(np.full(T.size, LIMIT), limit=20.0), "controller")
    assert found is not None
    assert found.fraction == 0.0
