"""The vehicles of the gallery are those of their sources."""

from __future__ import annotations

import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks.right_hand_sides import COLUMNS, page
from published_rates import (
    NAMES,
    against_model,
    against_published,
    expressible,
    published,
    rates_of,
)

from cosim.models import STATE, TABLE_1, thrust_map, vehicle_derivatives
from cosim.vehicle import VEHICLES, load_vehicle

TOLERANCE = 1e-9
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "vehicles.md"


@pytest.mark.parametrize("name", NAMES)
def test_rates_are_those_of_the_model(name: str) -> None:
    """Random states, actuators and currents; errors of the published form corrected."""
    found = against_model(name)
    assert found.cases >= 40
    assert max(found.speed, found.position, found.entry) < TOLERANCE


@pytest.mark.parametrize("name", NAMES)
def test_published_form_has_the_published_rates(name: str) -> None:
    """Its errors included, as far as a vehicle file can express them."""
    found = against_published(name)
    assert found.cases >= 20
    assert max(found.speed, found.position) < TOLERANCE
    # npsauv.m guards a division by the speed with 1e-10 m/s, which small entries feel
    assert found.entry < (10 if name == "nps-auv2-6dof" else 1) * TOLERANCE


@pytest.mark.parametrize("name", NAMES)
def test_errors_of_the_published_form_are_seen(name: str) -> None:
    """With currents, or with w and q, published and modelled rates differ: the cases see it."""
    cases = published(name)["cases"]
    apart = [np.linalg.norm(np.subtract(c["published"], c["modelled"])) for c in cases]
    assert max(apart) > 1e-3
    assert sum(d > 1e-6 for d in apart) >= 8
    assert any(expressible(name, c) for c in cases)


@pytest.mark.parametrize("name", NAMES)
def test_cases_see_every_parameter(name: str) -> None:
    """A parameter that is off by a thousandth changes the rates of some case by much more."""
    vehicle, cases = load_vehicle(name), published(name)["cases"][-6:]
    plain = [rates_of(vehicle, name, c) for c in cases]
    unseen = []
    for parameter, value in vehicle.parameters.items():
        # commands are at what the actuators do; softening is far below the speeds
        if value == 0.0 or parameter.startswith(("limit.", "lag.", "cross_flow.softening")):
            continue
        changed = [rates_of(vehicle, name, c, **{parameter: value * 1.001}) for c in cases]
        seen = max(
            np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(changed, plain, strict=True)
        )
        if seen < 10 * TOLERANCE:
            unseen.append((parameter, seen))
    assert unseen == []


def test_table_1_is_the_nps_auv_2() -> None:
    """All 22 derivatives as corrected here are those of npsauv.m, and so are the vehicle files'."""
    theirs = published("nps-auv2-6dof")["derivatives"]
    ours = {k.removeprefix("hydro."): v for k, v in TABLE_1.items() if k.startswith("hydro.")}
    assert len(ours) == 22
    assert ours == {name: theirs[name] for name in ours}
    for vehicle, count in (("nps-auv2", 22), ("nps-auv2-6dof", len(theirs))):
        given = load_vehicle(vehicle).parameters
        named = {k.removeprefix("hydro."): v for k, v in given.items() if k.startswith("hydro.")}
        named.pop("X_abs_u_u", None)  # of the propulsion term, not among the derivatives
        assert len(named) == count
        assert named == {name: theirs[name] for name in named}
    assert (load_vehicle("nps-auv2").parameters["mass"], TABLE_1["mass"]) == (5454.0, 5454.0)
    assert load_vehicle("nps-auv2-6dof").parameters["mass"] == pytest.approx(5443.4, abs=0.05)


def test_nps_auv2_is_the_built_in_plant() -> None:
    """Rates of the vehicle file and of `vehicle_derivatives`, delay, forces and disturbance too."""
    vehicle = load_vehicle("nps-auv2")
    assert vehicle.states == STATE
    p, drawn = dict(vehicle.parameters), random.Random(3)  # noqa: S311 - no secret
    p = {name: p[name] for name in (*TABLE_1, *(f"damping.{a}" for a in "uvwr"))}
    assert {k: p[k] for k in TABLE_1} == dict(TABLE_1)
    for _ in range(20):
        x, late = ([drawn.uniform(-1, 1) for _ in range(8)] for _ in range(2))
        force = [drawn.uniform(-2000, 2000) for _ in range(4)]
        disturbance = [drawn.uniform(-0.1, 0.1) for _ in range(4)]
        ours = vehicle.rates(x, late, [*force, 0.0, 0.0, 0.0, *disturbance])
        theirs = vehicle_derivatives(x, late[4:], force, disturbance, p, thrust_map(p), math)
        assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("name", VEHICLES)
def test_what_is_controlled_is_measured_and_bounded(name: str) -> None:
    """Each controlled state by one sensor whose age covers its interval; speeds in the envelope."""
    vehicle = load_vehicle(name)
    assert vehicle.source
    measured = [state for sensor in vehicle.sensors for state in sensor.measures]
    assert len(measured) == len({*measured})
    assert {*vehicle.control.states} <= {*measured}
    assert {s for s in measured if s.startswith("nu.")} <= {*vehicle.envelope}
    assert all(0.05 <= s.interval < s.age for s in vehicle.sensors)
    assert [s.measures for s in vehicle.sensors if s.over == "link"] == [("eta.x", "eta.y")]


def test_page_is_that_of_the_script() -> None:
    """But for the figures of the comparison, whose last digits are those of a machine."""

    def without_figures(lines: list[str]) -> list[str]:
        """Cut the figures off the rows of the comparison."""
        kept = [re.sub(r"( \| \d\.\de[-+]\d\d){3} \|$", "", line) for line in lines]
        assert sum(a != b for a, b in zip(kept, lines, strict=True)) == 2 * len(NAMES)
        return kept

    printed = "\n".join(page()).splitlines()
    assert f"| {' | '.join(COLUMNS)} |" in printed
    assert without_figures(PAGE.read_text("utf-8").splitlines()) == without_figures(printed)
