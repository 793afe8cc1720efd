"""When the sampled controller samples: held to exact arithmetic."""

from __future__ import annotations

from fractions import Fraction
from math import ceil
from typing import Any

import pytest

from cosim.fmu.export import component_module

StateFeedback = component_module("hinf_controller.behaviour").StateFeedback
PAPER_SPEC = component_module("hinf_controller.variables").PAPER_SPEC
VEHICLE_SPEC = component_module("hinf_controller.variables").SPEC


def controller(sample_time: float, start: float = 0.0) -> tuple[Any, dict[str, Any]]:
    """Give u = x[1], sampled."""
    values = {v.name: v.start for v in PAPER_SPEC.variables}
    values |= {"K[1,1]": 1.0, "K[1,2]": 0.0, "sample_time": sample_time}
    feedback = StateFeedback(dict(PAPER_SPEC.constants))
    feedback.initialise(values, start)
    return feedback, values


def sampled_at(sample_time: str, step: str, count: int, first: int = 0) -> list[float]:
    """Give u after each step when the input is the index of the step, by the behaviour."""
    start = float(Fraction(step) * first)
    feedback, values = controller(float(Fraction(sample_time)), start)
    seen = []
    for k in range(first, first + count):
        values["x[1]"] = float(k)
        # an end as a master computes it, rounding included
        feedback.advance(values, float(Fraction(step) * k) + float(step))
        seen.append(values["u[1]"])
    return seen


def expected(sample_time: str, step: str, count: int, first: int = 0) -> list[float]:
    """Do the same in exact arithmetic: a sample at m T lies in the step [k h, k h + h)."""
    T, h = Fraction(sample_time), Fraction(step)
    seen, last, done = [], 0.0, 0
    for k in range(first, first + count):
        due = ceil(h * (k + 1 - first) / T)  # instants before the end of this step
        if due > done:
            last, done = float(k), due
        seen.append(last)
    return seen


@pytest.mark.parametrize("step", ["0.01", "0.05", "0.1", "0.03", "0.001"])
@pytest.mark.parametrize("sample_time", ["0.05", "0.1", "0.3", "0.07", "0.01", "1/3"])
def test_samples_fall_into_the_steps_they_belong_to(sample_time: str, step: str) -> None:
    """Over 2000 steps no rounding moves a sample into a neighbouring step."""
    assert sampled_at(sample_time, step, 2000) == expected(sample_time, step, 2000)


def test_samples_stay_in_place_after_days() -> None:
    """Ten days into a run, where a double resolves 1e-10 s, samples still meet their steps."""
    first = 864_000 * 20
    assert sampled_at("0.1", "0.05", 400, first) == expected("0.1", "0.05", 400, first)


def test_sample_time_of_zero_samples_at_every_point() -> None:
    """Zero means every communication point, however long the steps."""
    feedback, values = controller(0.0)
    for k in range(10):
        values["x[1]"] = k + 1.0
        feedback.advance(values, (k + 1) * 0.37)
        assert values["u[1]"] == k + 1.0


def test_sample_time_far_below_the_step_costs_nothing() -> None:
    """A nanosecond's sample time is not counted through: that would take days."""
    for sample_time in (1e-9, 1e-15, 1e-300):
        feedback, values = controller(sample_time)
        values["x[1]"] = 4.0
        feedback.advance(values, 1000.0)
        assert values["u[1]"] == 4.0


def test_vehicle_controller_maps_and_limits() -> None:
    """Force = M K (x - reference), each within its limit: one axis by hand."""
    values = {v.name: v.start for v in VEHICLE_SPEC.variables}
    values |= {name: 0.0 for name in values if name.startswith("K[")}
    values |= {"K[1,1]": -0.06, "K[3,3]": -0.06}
    values |= {"sample_time": 0.0, "eta.x": 1.0, "reference.x": 3.0, "eta.z": 1000.0}
    feedback = StateFeedback(dict(VEHICLE_SPEC.constants))
    feedback.initialise(values, 0.0)
    assert values["force.x"] == 0.0
    feedback.advance(values, 0.1)
    surge_mass = 5454 + 500 * 5.3**3 * 7.6e-3
    assert values["force.x"] == pytest.approx(
        surge_mass * values["K[1,1]"] * (1.0 - 3.0), rel=1e-12
    )
    assert values["force.z"] == -2500.0
    assert values["moment.z"] == 0.0
