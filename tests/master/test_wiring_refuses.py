"""Systems that are refused, and runs that end early: messages, and rows that are kept."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from coupled import end, ns, rewritten, section_5, system

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.master import Component, Endpoint, make_schedule, simulate
from cosim.network import PacketLink, TransportLink

if TYPE_CHECKING:
    from pathlib import Path

PLANT = {"plant": ("DelayedPlant", {})}
QUIET = {"D1[1,1]": 0.4}
TWO = {"a": ("DelayedPlant", QUIET), "b": ("DelayedPlant", QUIET)}
VEHICLE = {"auv": ("AuvPlant", {}), "controller": ("HinfController", {}), "sea": ("WaveField", {})}

REFUSED: dict[str, tuple[dict[str, Any], list[tuple[str, ...]], str]] = {
    "unknown component": (PLANT, [("plan.x[1]", "plant.u[1]")], "there is no component 'plan'"),
    "unknown variable": (PLANT, [("plant.x[7]", "plant.u[1]")], "there is no variable 'x[7]'"),
    "unknown target": (PLANT, [("plant.x[1]", "plant.v[1]")], "there is no variable 'v[1]'"),
    "unknown link": (PLANT, [("plant.x[1]", "plant.u[1]", "radio")], "there is no link 'radio'"),
    "two sources": (
        PLANT,
        [("plant.x[1]", "plant.u[1]"), ("plant.x[2]", "plant.u[1]")],
        "plant.u[1]: an input has two sources",
    ),
    "input as source": (
        PLANT,
        [("plant.u[1]", "plant.w[1]")],
        "a connection leads from an output to an input",
    ),
    "parameter as target": (
        PLANT,
        [("plant.x[1]", "plant.A[1,1]")],
        "a connection leads from an output to an input",
    ),
    "unit": (
        VEHICLE,
        [("controller.moment.z", "auv.force.x")],
        "the units of the two ends differ\n  got: N.m -> N",
    ),
    "another unit": (
        VEHICLE,
        [("sea.disturbance.r", "auv.disturbance.u")],
        "got: rad/s2 -> m/s2",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_connection_is_refused(fmus: Path, case: str) -> None:
    """Where, what was expected, and the nearest name if it may be a slip."""
    components, connections, message = REFUSED[case]
    with pytest.raises(InputError) as caught:
        system(fmus, components, connections, step=0.1, stop=1.0)
    assert message in str(caught.value)


def test_near_names_are_suggested(fmus: Path) -> None:
    """A misspelt name is answered with the nearest one."""
    with pytest.raises(InputError, match="did you mean plant"):
        system(fmus, PLANT, [("plnt.x[1]", "plant.u[1]")], step=0.1, stop=1.0)


def test_input_both_driven_and_connected_is_refused(fmus: Path) -> None:
    """A signal and a connection cannot both have an input; nor can a signal have an output."""
    connections = [("plant.x[1]", "plant.u[1]")]
    with pytest.raises(InputError, match="two sources"):
        system(fmus, PLANT, connections, step=0.1, stop=1.0, driven={"plant.u[1]": math.sin})
    with pytest.raises(InputError, match="can follow a signal"):
        system(fmus, PLANT, [], step=0.1, stop=1.0, driven={"plant.x[1]": math.sin})
    with pytest.raises(InputError, match="must be finite"):
        system(fmus, PLANT, [], step=0.1, stop=1.0, driven={"plant.u[1]": lambda _t: math.nan})


@pytest.mark.parametrize("link", [None, TransportLink("line", ns(0.05))])
def test_algebraic_loop_names_its_components(fmus: Path, link: TransportLink | None) -> None:
    """z of a into w of b and back is refused, and the suggested remedy works.

    A transport delay of less than a step needs the value of the point itself.
    """
    over = (link.name,) if link else ()
    connections = [("a.z[1]", "b.w[1]", *over), ("b.z[1]", "a.w[1]", *over)]
    given = system(fmus, TWO, connections, step=0.1, stop=1.0, links=[link] if link else [])
    with pytest.raises(InputError) as caught:
        simulate(given)
    text = str(caught.value)
    assert "the connections form an algebraic loop" in text
    assert text.startswith(("a -> b -> a", "b -> a -> b"))
    assert "got: a.z[1] -> b.w[1], b.z[1] -> a.w[1]\n" in text
    assert "put a packet link with a delay into the loop" in text
    packet = PacketLink("line", ns(0.1), delay_ns=ns(0.1))
    connections[1] = ("b.z[1]", "a.w[1]", "line")
    connections[0] = ("a.z[1]", "b.w[1]")
    run = simulate(system(fmus, TWO, connections, step=0.1, stop=0.5, links=[packet]))
    assert run.status == "finished"
    sent = run.signal("b", "z[1]")
    assert np.array_equal(run.signal("a", "w[1]")[1:], sent[:-1])


def test_feedthrough_to_its_own_input_is_an_algebraic_loop(fmus: Path) -> None:
    """z into the same plant's w."""
    given = system(fmus, PLANT, [("plant.z[1]", "plant.w[1]")], step=0.1, stop=1.0)
    with pytest.raises(InputError, match="plant -> plant: the connections form an algebraic"):
        simulate(given)


def test_state_feedback_is_not_an_algebraic_loop(fmus: Path) -> None:
    """x into the same plant's u is a sampled feedback, not an algebraic loop."""
    given = system(fmus, PLANT, [("plant.x[1]", "plant.u[1]")], step=0.1, stop=1.0)
    assert simulate(given).status == "finished"


@pytest.mark.parametrize(("step", "stop"), [(0, 10**9), (-1, 10**9), (10**9, 10**8)])
def test_step_that_does_not_fit_is_refused(step: int, stop: int) -> None:
    """Zero, negative, or longer than the run."""
    with pytest.raises(InputError, match="the communication step does not fit the run"):
        make_schedule({}, step, stop, "align")


def test_far_too_many_points_are_refused() -> None:
    """A nanosecond's step over an hour is a mistake in the units."""
    with pytest.raises(InputError, match="too many communication points"):
        make_schedule({}, 1, 3600 * 10**9, "align")


def test_unknown_parameter_is_refused(fmus: Path) -> None:
    """So is an output set like a parameter, and a value beyond its bounds."""
    for parameters, message in (
        ({"delay.e": 1.0}, "there is no variable 'delay.e'"),
        ({"x[1]": 1.0}, "x[1] cannot be set"),
        ({"delay.d": -1.0}, "delay.d is out of range"),
    ):
        with pytest.raises(InputError) as caught:
            simulate(system(fmus, {"plant": ("DelayedPlant", parameters)}, [], step=0.1, stop=1.0))
        assert message in str(caught.value)


def test_unknown_signal_of_a_run(fmus: Path) -> None:
    """Asking a run for what it does not have names what it has."""
    run = simulate(system(fmus, PLANT, [], step=0.1, stop=0.2))
    with pytest.raises(InputError, match="there is no component 'plane'"):
        run.signal("plane", "x[1]")
    with pytest.raises(InputError, match="there is no signal 'y'"):
        run.signal("plant", "y")


def test_component_that_fails_ends_the_run(fmus: Path) -> None:
    """A delay with too many sub-steps: "failed", with the component's message, row 0 kept."""
    run = simulate(section_5(fmus, step=0.1, stop=1.0, plant={"delay.d": 1e-12}))
    assert run.status == "failed"
    assert run.reason is not None
    assert "component 'plant' (DelayedPlant.fmu)" in run.reason
    assert "use a shorter communication step" in run.reason
    assert run.points_ns.tolist() == [0]
    assert run.signal("plant", "x[1]").tolist() == [10.0]


def test_divergence_ends_the_run(fmus: Path) -> None:
    """An output beyond the range: "diverged", named, with the row that did it."""
    run = simulate(
        section_5(fmus, step=0.1, stop=9.0, plant={"A[1,1]": 5.0}, divergence=1000.0),
    )
    assert run.status == "diverged"
    assert run.reason is not None
    assert run.reason.startswith("plant.")
    assert "left the range of +-1000" in run.reason
    last = np.abs([run.signal("plant", name) for name in ("x[1]", "x[2]", "z[1]", "z[2]")])
    assert last[:, -1].max() > 1000.0 >= last[:, :-1].max()


def test_overflow_within_one_step_from_moderate_values_is_a_failure(fmus: Path) -> None:
    run = simulate(section_5(fmus, step=1.0, stop=9.0, plant={"A[1,1]": 5000.0}, divergence=None))
    assert run.status == "failed"
    assert run.reason is not None
    assert "component 'plant'" in run.reason
    assert "no longer finite" in run.reason
    assert run.points_ns.tolist() == [0]


@pytest.mark.parametrize("rate", [8.0, 40.0])
def test_growth_step_by_step_until_overflow_is_divergence(fmus: Path, rate: float) -> None:
    run = simulate(section_5(fmus, step=0.1, stop=120.0, plant={"A[1,1]": rate}, divergence=None))
    assert run.status == "diverged"
    assert run.reason is not None
    assert "no longer finite" in run.reason
    assert np.abs(run.signal("plant", "x[1]")).max() > 1e100


def test_fixed_step_fmu_is_refused_where_steps_vary(fmus: Path, tmp_path: Path) -> None:
    """Under "align" points are uneven: refused with the way out, which then works."""
    stiff = rewritten(
        fmus / "PaperController.fmu",
        tmp_path / "PaperController.fmu",
        ('canHandleVariableCommunicationStepSize="true"', ""),
    )
    link = PacketLink("sc", ns(0.1), delay_ns=ns(0.033))

    def replaced(events: Any, stop: float = 1.0) -> Any:
        given = section_5(fmus, step=0.05, stop=stop, links=[link], events=events)
        components = {**given.components, "controller": Component(describe_fmu(stiff))}
        return dataclasses.replace(given, components=components)

    with pytest.raises(InputError) as caught:
        replaced("align")
    assert "component 'controller' (PaperController.fmu)" in str(caught.value)
    assert "this FMU takes steps of one size only" in str(caught.value)
    assert 'set events = "grid" and an end that is a multiple of the step' in str(caught.value)
    with pytest.raises(InputError, match="steps of one size only"):
        replaced("grid", stop=1.02)
    assert simulate(replaced("grid")).status == "finished"


def test_link_that_is_not_in_the_schedule_is_refused(fmus: Path) -> None:
    """A link under another name, or one without a schedule, is refused."""
    link = PacketLink("sc", ns(0.1))
    given = section_5(fmus, step=0.1, stop=1.0, links=[link])
    with pytest.raises(InputError, match="pass the same links to make_schedule"):
        dataclasses.replace(given, links={"other": link}, connections=[])
    without = make_schedule({}, ns(0.1), ns(1.0), "align")
    with pytest.raises(InputError, match="link 'sc': the link does not match its entry"):
        dataclasses.replace(given, comm_schedule=without)


def test_endpoint_is_formatted_as_component_and_variable() -> None:
    """An endpoint is formatted as component.variable."""
    assert str(end("plant.x[1]")) == "plant.x[1]"
    assert end("auv.eta.x") == Endpoint("auv", "eta.x")
