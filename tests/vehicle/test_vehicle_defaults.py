"""What is taken where a vehicle file leaves it open, and what a flight makes of it."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cosim import hinf
from cosim.core import NotAchievableError
from cosim.vehicle import (
    FlightSettings,
    Mission,
    as_designed_for,
    certified_design,
    flight_model,
    fly,
    linear_model,
    vehicle_from_toml,
    vehicle_text,
)

HOVER = ("eta.x", "eta.y", "eta.z", "eta.psi", "nu.u", "nu.v", "nu.w", "nu.r")
STEERED = ("eta.z", "eta.theta", "eta.psi", "nu.v", "nu.w", "nu.q", "nu.r")


def without(text: str, *tables: str) -> str:
    """A vehicle file without some of its tables."""
    parts = re.split(r"(?m)^(?=\[)", text)
    return "".join(part for part in parts if not part.startswith(tables))


def bare(name: str, *more: str) -> str:
    """A vehicle of the gallery as published numbers give it: body, hull and actuators."""
    return without(vehicle_text(name), "[[sensors]]", "[trim]", "[envelope]", "[control]", *more)


def test_what_actuators_move_and_sensors_show_is_controlled() -> None:
    """Roll and pitch are left to the restoring moments; a vehicle that fins steer has a speed."""
    hovering = vehicle_from_toml(bare("bluerov2-heavy"), where="x")
    assert set(hovering.control.states) == set(HOVER)
    assert not hovering.trim
    steered = vehicle_from_toml(bare("remus100"), where="x")
    assert steered.control.states == STEERED
    assert steered.trim == {"nu.u": 1.5}  # 2 m/s take more than half of the propeller
    assert [s.name for s in steered.sensors] == ["dvl", "attitude", "gyro", "depth", "usbl"]
    assert set(steered.defaults) == {"envelope", "sensors", "trim", "control.states"}
    own = vehicle_from_toml(vehicle_text("remus100"), where="x")
    assert not own.defaults


def test_roll_and_pitch_are_controlled_where_nothing_holds_them() -> None:
    text = bare("bluerov2-heavy").replace("r_b = [0.0, 0.0, -0.01]", "r_b = [0.0, 0.0, 0.01]")
    states = vehicle_from_toml(text, where="x").control.states
    assert {"eta.phi", "eta.theta", "nu.p", "nu.q", *HOVER} == set(states)


def test_what_no_sensor_shows_is_not_controlled_by_default_and_refused_by_name() -> None:
    kept = '[[sensors]]\nname = "log"\nmeasures = ["eta.z", "nu.r", "nu.u"]\ninterval = 0.2\n'
    text = bare("bluerov2-heavy") + kept
    found = vehicle_from_toml(text, where="x")
    assert set(found.control.states) == {"eta.z", "nu.u", "nu.w", "nu.r"}
    assert flight_model(found)[1] == []
    asked = vehicle_from_toml(text + '[control]\nstates = ["eta.x", "nu.u"]\n', where="x")
    error = flight_model(asked)[1][0]
    assert "eta.x" in str(error)


def test_a_flight_has_euler_angles_and_lags_of_fins() -> None:
    """The effect of a fin without a lag depends on the speed, which no command may."""
    text = bare("remus100").replace("lag = 0.1\n", "", 1)
    text = text.replace("degrees_of_freedom = 6", 'degrees_of_freedom = 6\nattitude = "quaternion"')
    remarks: list[str] = []
    vehicle = as_designed_for(vehicle_from_toml(text, where="x"), remarks.append)
    assert vehicle.attitude == "euler"
    assert [a.lag for a in vehicle.actuators] == [1.0, 0.1, 0.1]
    assert len(remarks) == 2
    own = vehicle_from_toml(vehicle_text("remus100"), where="x")
    assert as_designed_for(own, remarks.append) is own


def tried(monkeypatch: pytest.MonkeyPatch, gains: list[float], text: str) -> list[float]:
    """Bounds of the surge for which designs are tried that miss by these gains."""
    vehicle = vehicle_from_toml(text, where="x")
    found: list[float] = []
    models = iter(gains)

    def model(vehicle: Any, *, envelope: dict[str, float] | None = None) -> Any:
        found.append((envelope or vehicle.envelope)["nu.w"])
        return linear_model(vehicle, envelope=envelope)

    def refuse(*_: Any, **__: Any) -> Any:
        raise hinf.synthesis.TooUncertainError("too uncertain", next(models))

    monkeypatch.setattr("cosim.vehicle.flight_design.linear_model", model)
    monkeypatch.setattr("cosim.hinf.design_output_feedback", refuse)
    whole = linear_model(vehicle)
    with pytest.raises(NotAchievableError, match=r"smaller bounds.*\[envelope\]") as caught:
        certified_design(whole, FlightSettings(), Path("none"), lambda _: None)
    assert re.match(r"most uncertain is nu\.[wqr]' by ", caught.value.hint or "")
    return found


def test_a_smaller_envelope_is_chosen_by_how_much_was_missed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Gains round F go with the share: 2 at the whole, so a third is tried, not 0.7."""
    found = tried(monkeypatch, [2.0, 1.1, 1.0, 1.0], vehicle_text("remus100"))
    assert found == pytest.approx([0.25 * 0.05, 0.125 * 0.05, 0.06 * 0.05])


def test_a_poor_proof_is_compared_with_one_for_half_the_envelope(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A gamma of ten times the norm; of half the envelope it is twice, and that is taken."""
    whole = linear_model(vehicle_from_toml(vehicle_text("remus100"), where="x"))
    gammas = iter([10.0, 2.0, 10.0, 8.0])

    def design(*_: Any, **__: Any) -> Any:
        return SimpleNamespace(gamma=next(gammas), exact_norm=1.0, K=None, L=None)

    monkeypatch.setattr("cosim.hinf.design_output_feedback", design)
    for gamma, share in ((2.0, 0.5), (10.0, 1.0)):
        found = certified_design(whole, FlightSettings(), Path("none"), lambda _: None)
        assert found[2].gamma == gamma
        assert found[0].envelope["nu.w"] == share * whole.envelope["nu.w"]


def test_thrusters_above_the_centre_are_for_surge_and_sway() -> None:
    """They pitch and roll a vehicle more than they move it, but nothing else moves it."""
    text = re.sub(r"0\.085\]", "0.3]", bare("bluerov2-heavy"))
    vertical = re.compile(r'\[\[thrusters\]\]\nname = "t[67]".*?\n\n', re.DOTALL)
    states = vehicle_from_toml(vertical.sub("", text), where="x").control.states
    assert set(HOVER) <= set(states)


def test_a_calmer_mission_has_a_share_of_everything() -> None:
    calm = Mission({1: 2.0}, {1: 0.2}, 0.5).calmer(0.5)
    assert (calm.set_points, calm.errors, calm.wave_height) == ({1: 1.0}, {1: 0.1}, 0.25)


@pytest.mark.slow
def test_body_hull_and_actuators_alone_are_certified_and_run(tmp_path: Path) -> None:
    flight = fly(vehicle_from_toml(bare("bluerov2-heavy"), where="x"), tmp_path)
    assert flight.design.gamma is not None
    assert all(flight.outcome.metrics["assumptions"].values())
