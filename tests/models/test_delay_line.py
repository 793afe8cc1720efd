"""The method of steps against closed forms and the reference solver."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from truth.dde import Hold, solve

from cosim.models import DelayLine

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

END = 3.0
CASES = {
    "no delay": ([0.0], 0.25),
    "commensurate": ([0.5], 0.25),
    "delay shorter than the step": ([0.1], 0.25),
    "incommensurate": ([1 / math.sqrt(7)], 0.25),
    "incommensurate step": ([0.3], 1 / math.pi),
    "two delays": ([0.3, 0.47], 0.25),
    "two delays, one zero": ([0.0, 0.41], 0.37),
}


def lagged(t: float) -> list[float]:
    """Give two inputs as sampled at a communication point."""
    return [math.cos(2.1 * t), math.sin(1.3 * t)]


def rate(x: Sequence[float], late: Sequence[Sequence[float]], u: Sequence[float]) -> list[float]:
    """Two states, coupled and nonlinear, with every delay in both."""
    first = -0.4 * x[0] + 0.3 * math.sin(x[1]) + u[0]
    second = 0.5 * math.cos(x[0]) - 0.2 * x[1] + u[1]
    for k, past in enumerate(late):
        first -= (1.1 - 0.3 * k) * past[0] * (1 + 0.1 * past[1])
        second += (0.3 + 0.2 * k) * past[0] - 0.7 * past[1]
    return [first, second]


def points(period: float, end: float = END) -> list[float]:
    count = math.ceil(end / period - 1e-9)
    return [k * period for k in range(count)] + [end]


def right_hand_side(t: float) -> Callable[[float, list[float], list[list[float]]], list[float]]:
    u = lagged(t)
    return lambda _t, x, late: rate(x, late, u)


def run(delays: Sequence[float], period: float, step: float) -> np.ndarray:
    """Both states at every communication point after the start."""
    line = DelayLine([1.0, -0.5], delays, step)
    rows = []
    for now, end in pairwise(points(period)):
        line.advance(end, right_hand_side(now), jump=True)
        rows.append(line.x)
    return np.array(rows)


def truth(delays: Sequence[float], period: float) -> np.ndarray:
    times = points(period)[:-1]
    u = Hold(times, [np.array(lagged(t)) for t in times])
    x = solve(
        lambda t, x, late: rate(x, late, u(t)),  # type: ignore[arg-type]
        [1.0, -0.5],
        delays,
        END,
        switches=times,
    )
    return x.sample(points(period)[1:])


def simplest(step: float = 0.01) -> tuple[DelayLine, Callable[[float], None]]:
    """X' = -x(t-1), history 1, and how to advance it."""
    line = DelayLine([1.0], [1.0], step)
    return line, lambda end: line.advance(end, lambda _t, _x, late: [-late[0][0]], jump=False)


@pytest.mark.parametrize("period", [1.0, 0.1, 0.37, 5.0])
def test_simplest_delay_equation_at_its_known_values(period: float) -> None:
    """X' = -x(t-1), history 1: 0, -1/2, -1/6, 19/120 at 1, 2, 3, 5, for any way to get there."""
    line, advance = simplest(step=0.005)
    for t, x in ((1.0, 0.0), (2.0, -1 / 2), (3.0, -1 / 6), (5.0, 19 / 120)):
        while line.time + period < t - 1e-9:
            advance(line.time + period)
        advance(t)
        assert line.x[0] == pytest.approx(x, abs=2e-11)


@pytest.mark.parametrize("case", CASES)
def test_order_four_with_zero_order_hold_inputs(case: str) -> None:
    """Halving the step divides the error by 16 (13 to 20), for any delay and period."""
    delays, period = CASES[case]
    exact = truth(delays, period)
    steps = [0.1 / 2**k for k in range(4)]
    errors = [float(np.linalg.norm(run(delays, period, step) - exact)) for step in steps]
    ratios = [a / b for a, b in pairwise(errors)]
    assert all(13.0 < ratio < 20.0 for ratio in ratios), (errors, ratios)


@pytest.mark.parametrize("case", CASES)
def test_agrees_with_the_reference(case: str) -> None:
    """At a step of 1/512 s the reference is met to 1e-10."""
    delays, period = CASES[case]
    got = run(delays, period, 1 / 512)
    assert np.allclose(got, truth(delays, period), rtol=0, atol=1e-10)


@pytest.mark.parametrize("delays", [[0.0], [0.5], [0.3, 0.47]])
def test_result_is_independent_of_the_communication_step(delays: list[float]) -> None:
    """Without inputs the communication step changes the result within the method's error only."""
    ends = []
    for period in (0.05, 0.13, 0.4, 3.0):
        line = DelayLine([1.0, -0.5], delays, 1 / 256)
        for end in points(period)[1:]:
            line.advance(end, lambda _t, x, late: rate(x, late, [0.0, 0.0]), jump=False)
        ends.append(line.x)
    for other in ends[1:]:
        assert other == pytest.approx(ends[0], abs=5e-10)


def test_time_dependent_right_hand_side() -> None:
    """X' = cos t + x(t-d) is integrated with the time it is given, from any start."""
    exact = solve(lambda t, _x, late: math.cos(t + 7.0) + late[0], [0.2], [0.4], 2.0)
    line = DelayLine([0.2], [0.4], 1 / 256, start=7.0)
    for k in range(1, 9):
        line.advance(7.0 + k / 4, lambda t, _x, late: [math.cos(t) + late[0][0]], jump=False)
    assert line.x[0] == pytest.approx(exact(2.0)[0], abs=1e-10)


@pytest.mark.parametrize("case", CASES)
def test_restored_snapshot_continues_bit_for_bit(case: str) -> None:
    """A line restored from JSON text, in a new object, goes on as the original does."""
    delays, period = CASES[case]
    line = DelayLine([1.0, -0.5], delays, 0.03)
    times = points(period)
    half = len(times) // 2
    for now, end in pairwise(times[: half + 1]):
        line.advance(end, right_hand_side(now), jump=True)
    other = DelayLine([9.0, 9.0], delays, 0.03)
    other.restore(json.loads(json.dumps(line.snapshot())))
    for now, end in pairwise(times[half:]):
        line.advance(end, right_hand_side(now), jump=True)
        other.advance(end, right_hand_side(now), jump=True)
        assert other.x == line.x
    assert other.snapshot() == line.snapshot()


def test_snapshot_is_not_changed_by_what_follows() -> None:
    """A snapshot does not change, and can be restored twice."""
    line, advance = simplest()
    advance(1.5)
    saved = line.snapshot()
    text = json.dumps(saved)
    advance(2.5)
    far = list(line.x)
    assert json.dumps(saved) == text
    for _ in range(2):
        line.restore(saved)
        advance(2.5)
        assert line.x == far


def test_history_is_cut_but_never_too_short() -> None:
    """Memory stays bounded over 50 delays, and the longest delay can still be read."""
    line = DelayLine([1.0], [0.2], 0.01)
    for k in range(1, 1001):
        line.advance(k * 0.01, lambda _t, _x, late: [-late[0][0]], jump=True)
        assert len(line.snapshot()["pieces"]) < 200
    exact = solve(lambda _t, _x, late: -late[0], [1.0], [0.2], 2.0)
    again = DelayLine([1.0], [0.2], 0.01)
    for k in range(1, 201):
        again.advance(k * 0.01, lambda _t, _x, late: [-late[0][0]], jump=True)
    assert again.x[0] == pytest.approx(exact(2.0)[0], abs=1e-9)


def test_deleted_history_is_not_extrapolated() -> None:
    """A time before the kept history is refused."""
    line, advance = simplest()
    advance(1.0)
    assert line.at(0.5)[0] == pytest.approx(0.5, abs=1e-14)
    advance(5.0)
    with pytest.raises(LookupError, match=r"asked for 0\.5 s"):
        line.at(0.5)


def test_history_before_the_start_is_the_constant() -> None:
    """x(t) = initial for every t up to the start."""
    line, advance = simplest()
    assert line.at(-5.0) == [1.0]
    advance(0.5)
    assert line.at(0.0) == [1.0]
    assert line.at(0.25)[0] == pytest.approx(0.75, abs=1e-14)


@pytest.mark.parametrize("delay", [-0.1, math.nan, math.inf])
def test_invalid_delay_is_refused(delay: float) -> None:
    """A delay that is negative or not finite is refused."""
    with pytest.raises(ValueError, match="finite and not negative, got"):
        DelayLine([1.0], [0.1, delay], 0.1)


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, math.inf])
def test_invalid_internal_step_is_refused(step: float) -> None:
    """A step that is zero, negative or not finite is refused."""
    with pytest.raises(ValueError, match="finite and positive, got"):
        DelayLine([1.0], [0.1], step)


@pytest.mark.parametrize("end", [1.0, 0.5, math.nan])
def test_step_back_is_refused(end: float) -> None:
    """Time goes forward."""
    _, advance = simplest()
    advance(1.0)
    with pytest.raises(ValueError, match="must end after"):
        advance(end)


@pytest.mark.parametrize("delay", [1e-9, 1e-300, 5e-324])
def test_delay_that_needs_too_many_sub_steps_is_refused(delay: float) -> None:
    """A delay that needs millions of sub-steps is refused."""
    line = DelayLine([1.0], [delay], 0.1)
    with pytest.raises(ValueError, match="use a shorter communication step"):
        line.advance(1.0, lambda _t, _x, late: [-late[0][0]], jump=True)


def test_internal_step_that_needs_too_many_sub_steps_is_refused() -> None:
    """An internal step that is far too small is refused."""
    line = DelayLine([1.0], [0.0], 1e-6)
    with pytest.raises(ValueError, match="at most 200000 are taken"):
        line.advance(10.0, lambda _t, x, _late: [-x[0]], jump=True)


def test_overflow_is_an_arithmetic_error() -> None:
    """X' = x^2 overflows; the error names the time."""
    line = DelayLine([1.0], [0.1], 0.01)
    with pytest.raises(ArithmeticError, match="no longer finite after t ="):
        line.advance(50.0, lambda _t, x, _late: [x[0] * x[0]], jump=True)
