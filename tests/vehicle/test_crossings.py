"""A flight says what crosses which link, and up to which age the proof holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cosim import hinf
from cosim.core import parse_toml
from cosim.models import DelaySystem
from cosim.vehicle import (
    DESIGN,
    FlightSettings,
    LinearModel,
    Mission,
    crossing_lines,
    crossing_title,
    crossings,
    load_vehicle,
    made_before,
    measurements_of,
    planned_sensors,
    scenario_text,
)

SETTINGS = FlightSettings()
DEEP = ("eta.z", "eta.theta", "eta.psi", "nu.w", "nu.q", "nu.r")
"""What the design of remus100 controls: neither x nor y."""


def lines(vehicle: str, states: tuple[str, ...], set_points: tuple[str, ...]) -> str:
    """The crossings of a vehicle of the gallery, as they are printed."""
    sensors = load_vehicle(vehicle).sensors
    found = crossings(planned_sensors(sensors, states, SETTINGS), set_points, SETTINGS)
    return "\n".join(crossing_lines(found, sensors, states))


def test_a_torpedo_whose_position_is_not_controlled_has_no_fixes() -> None:
    """Its fixes are left out by name; set-points alone cross the slow link, of any age."""
    words = lines("remus100", DEEP, ("eta.z", "eta.psi"))
    assert "no measurement crosses the slow link" in words
    assert "not used: usbl, since eta.x, eta.y are not controlled" in words
    assert "slow link: set-points: eta.z, eta.psi; the proof does not use their age" in words
    assert "on board: commands; any age up to 0.06 s" in words
    assert [x for x in words.splitlines() if x.startswith("over the slow link")] == [
        words.splitlines()[0]
    ]


def test_fixes_of_a_position_that_is_controlled_cross_the_link() -> None:
    """With the age that is proved."""
    words = lines("nps-auv2", ("eta.x", "eta.y", "nu.u", "nu.v"), ("eta.x",))
    assert "over the slow link: usbl: eta.x, eta.y; any age up to 6.1 s" in words
    assert "no measurement" not in words
    assert "not used" not in words


@pytest.mark.parametrize(
    ("states", "set_points", "title"),
    [
        (DEEP, {1: 1.0}, "set-points over a slow link, every measurement on board"),
        (DEEP, {}, "nothing crosses the slow link, loop closed on board"),
        (("eta.x", "nu.u"), {1: 1.0}, "usbl and set-points over a slow link, loop closed on board"),
        (("eta.x", "nu.u"), {}, "usbl over a slow link, loop closed on board"),
    ],
)
def test_the_scenario_of_a_flight_speaks_of_what_it_has(
    states: tuple[str, ...], set_points: dict[int, float], title: str
) -> None:
    """Its title, its description, and the link that its example of an outage names."""
    sensors = planned_sensors(load_vehicle("remus100").sensors, states, SETTINGS)
    mission = Mission(set_points, {}, 0.0)
    text = scenario_text("torpedo", states, (), ["fin"], {}, sensors, mission, SETTINGS)
    data: dict[str, Any] = parse_toml(text, "scenario.toml")
    assert data["title"] == f"torpedo: {title}"
    assert "fixes" not in text
    assert ("usbl" in data["links"]) == ("usbl" in title)
    assert ("set_points" in data["links"]) == bool(set_points)
    example = text.partition("# outage = [")[2].partition("]")[0].strip('"')
    assert example in data["links"]
    assert "usbl" in title or "usbl" not in data["description"]
    found = crossings(sensors, mission.names(states), SETTINGS)
    assert crossing_title(found) == title


def test_a_link_without_loss_and_jitter_is_a_link() -> None:
    """A measurement over it is not called one on board."""
    quick = FlightSettings(link=0.1, loss=0.0)
    sensors = planned_sensors(load_vehicle("nps-auv2").sensors, ("eta.x", "nu.u"), quick)
    assert {s.name: s.over for s in sensors} == {"onboard": "onboard", "usbl": "link"}


PLANT = DelaySystem(
    [[0, 1], [0, -0.1]], [[0], [1]], [[0], [1]], [[0.1, 0.0], [0.0, 0.0]], D2=[[0], [1]]
)


@pytest.mark.slow
def test_a_design_of_an_older_flight_keeps_its_gains_and_is_proved_for_late_commands(
    tmp_path: Path,
) -> None:
    """One that took commands to act at once; and nothing is made where they are not proved."""
    model = LinearModel.__new__(LinearModel)
    for name, value in {"system": PLANT, "states": ("eta.x", "nu.u"), "envelope": {}}.items():
        object.__setattr__(model, name, value)
    sensors = planned_sensors(load_vehicle("nps-auv2").sensors, model.states, SETTINGS)
    measured = measurements_of(model, sensors)
    gains: dict[str, Any] = {
        "gain": [[-0.06, -0.53]],
        "injections": [[[0.125], [0.5]], [[0.125], [0.0078125]]],  # exact with the noise
    }
    old = hinf.design_output_feedback(PLANT, measured, **gains, order=0, quick=True)
    (tmp_path / DESIGN).write_text(json.dumps(old.to_json()), "utf-8")
    words: list[str] = []
    found = made_before(model, measured, 0.06, tmp_path, words.append)
    assert found is not None
    assert (found.pair.command_age, found.pair.command_any_age) == (0.06, True)
    assert found.K.tolist() == old.K.tolist()
    assert [x.tolist() for x in found.L] == [x.tolist() for x in old.L]
    assert hinf.check_certificate(found.certificate).valid
    assert "any age up to 0.06 s" in words[0]
    assert made_before(model, measured, 60.0, tmp_path, words.append) is None
    assert "not proved" in words[1]
    (tmp_path / DESIGN).write_text(json.dumps(found.to_json()), "utf-8")
    again = made_before(model, measured, 0.06, tmp_path, words.append)
    assert again is not None
    assert again.certificate == found.certificate
