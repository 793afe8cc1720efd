"""What a right answer of an FMU can be; everything else is refused by name."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from cosim.core import ComponentError
from cosim.fmu import Returned

JUDGE = Returned("fmi3DoStep", "pump", "component 'pump' (pump.fmu)")
NAN, INF = math.nan, math.inf


@pytest.mark.parametrize("time", [1.0, 1.25, 1.5])
def test_time_reached_within_the_step_is_taken_as_it_is(time: float) -> None:
    """The ends belong to it."""
    assert JUDGE.time_reached(time, 1.0, 1.5) == time


def test_clock_that_lags_is_at_the_border_that_it_missed() -> None:
    """By less than a microsecond, or the resolution of doubles at great times."""
    assert JUDGE.time_reached(1.0 - 9e-7, 1.0, 1.5) == 1.0
    assert JUDGE.time_reached(1.5 + 9e-7, 1.0, 1.5) == 1.5
    late = 4e9
    assert JUDGE.time_reached(math.nextafter(late, 0.0), late, late + 1.0) == late
    assert JUDGE.next_event(1.0 - 9e-7, Fraction(1)) < 1


@pytest.mark.parametrize("time", [1.0 - 2e-6, 1.5 + 2e-6, -3.0, 0.0, 1e300, NAN, INF, -INF])
def test_time_reached_outside_of_the_step_is_refused(time: float) -> None:
    """The error names component, call, what was expected and what was got."""
    with pytest.raises(ComponentError) as caught:
        JUDGE.time_reached(time, 1.0, 1.5)
    error = caught.value
    assert error.where == "component 'pump' (pump.fmu)"
    assert (error.component, error.call, error.kind) == ("pump", "fmi3DoStep", None)
    assert error.what == "fmi3DoStep returned a last successful time that is not in its step"
    assert error.expected == "from t = 1 s to t = 1.5 s"
    assert error.got == f"t = {time:.10g} s"


def test_values_within_a_step_are_in_order() -> None:
    """Going back by less than a microsecond is standing still."""
    assert JUDGE.times_within([1.0, 1.2, 1.2 - 1e-7, 1.5], 1.0, 1.5) == [1.0, 1.2, 1.2, 1.5]
    for times in ([1.2, 1.1], [0.9], [1.6], [NAN]):
        with pytest.raises(ComponentError, match="not within its step"):
            JUDGE.times_within(times, 1.0, 1.5)


@pytest.mark.parametrize("time", [1.0 - 2e-6, -3.0, NAN, INF, -INF])
def test_next_event_is_to_come(time: float) -> None:
    """A finite time after the end of the run may be given: it does not come."""
    assert JUDGE.next_event(1e300, Fraction(1)) == Fraction(1e300)
    with pytest.raises(ComponentError, match="next event"):
        JUDGE.next_event(time, Fraction(1))


@pytest.mark.parametrize(
    ("raw", "got"),
    [(NAN, "nan s"), (INF, "inf s"), (-1e-9, "-1e-09 s"), ((1, 0), "1/0 s"), ((0, 0), "0/0 s")],
)
def test_interval_is_a_finite_time(raw: float | tuple[int, int], got: str) -> None:
    """Of a periodic Clock at least a nanosecond; rational ones stay exact."""
    assert JUDGE.interval("tick", (1, 3)) == Fraction(1, 3)
    assert JUDGE.interval("tick", 0.1) == Fraction(1, 10)
    assert JUDGE.interval("tick", 0.0) == 0
    with pytest.raises(ComponentError) as caught:
        JUDGE.interval("tick", raw)
    assert caught.value.got == got
    with pytest.raises(ComponentError, match="a shift of tick that is none"):
        JUDGE.interval("tick", raw, what="a shift")
    with pytest.raises(ComponentError, match="at least 1e-09 s"):
        JUDGE.interval("tick", 0.0, least=Fraction(1, 10**9))


@pytest.mark.parametrize("size", [2**24 + 1, 2**40, 2**64 - 1])
def test_size_is_judged_before_anything_is_read(size: int) -> None:
    """No byte at the address is read, nor is anything allocated."""
    with pytest.raises(ComponentError, match=f"{size} bytes"):
        JUDGE.content(8, size)
    assert JUDGE.content(None, 0) == b""
    with pytest.raises(ComponentError, match="3 bytes at no address"):
        JUDGE.content(None, 3)
    with pytest.raises(ComponentError, match="too large"):
        JUDGE.size_of_state(2**30 + 1)
