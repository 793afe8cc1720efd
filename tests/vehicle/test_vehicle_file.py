"""Vehicle files: what is read, and how what is wrong is refused, with its line."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from vehicle_files import EVERY_TERM, every_term, level

from cosim.core import InputError
from cosim.vehicle import (
    VEHICLES,
    load_vehicle,
    named_vehicle,
    vehicle_from_toml,
    vehicle_tables,
    vehicle_text,
)


def refused(text: str) -> InputError:
    with pytest.raises(InputError) as caught:
        vehicle_from_toml(text, where="v.toml")
    return caught.value


def line_with(text: str, start: str) -> int:
    return next(i for i, line in enumerate(text.splitlines(), 1) if line.startswith(start))


def test_a_file_becomes_states_inputs_and_parameters() -> None:
    vehicle = every_term()
    assert vehicle.states[-2:] == ("actual.propeller", "actual.rudder")
    assert vehicle.inputs[:4] == (
        "thruster.propeller", "thruster.bow", "fin.rudder", "fin.stern",
    )  # fmt: skip
    assert vehicle.inputs[4:] == (
        *(f"current.{axis}" for axis in "xyz"),
        *(f"disturbance.{letter}" for letter in "uvwpqr"),
    )
    p = vehicle.parameters
    assert p["hydro.X_abs_u_u"] == -5.0
    assert p["hydro.Y_abs_v_v"] == -60.0
    # position x direction plus the moment of the propeller
    assert {n: p[f"effect.propeller.{n}"] for n in "XKM"} == {"X": 1.0, "K": 0.02, "M": 0.01}
    assert {n: p[f"effect.bow.{n}"] for n in "YZMN"} == {"Y": 0.6, "Z": 0.8, "M": -0.4, "N": 0.3}
    assert "gravity" not in p
    assert p["weight"] == 294.0
    assert set(vehicle.envelope) - set(vehicle.default_bounds) == {"nu.u", "nu.q", "eta.theta"}
    assert {n: vehicle.envelope[n] for n in ("nu.u", "nu.q", "eta.theta", "eta.phi")} == {
        "nu.u": 0.3, "nu.q": 0.1, "eta.theta": 0.2, "eta.phi": 0.1,
    }  # fmt: skip
    assert level(4).envelope == {
        "eta.psi": 0.175, "nu.u": 0.15, "nu.v": 0.15, "nu.w": 0.15, "nu.r": 0.1,
    }  # fmt: skip
    assert vehicle.trim == {"nu.u": 1.0}
    assert vehicle.sensors[1].noise == (0.3, 0.3)
    assert vehicle.sensors[0].noise == (0.01,) * 3
    assert vehicle.control.weights == {"eta.z": 0.1, "fin.stern": 1.0}
    assert level(4).control.states == level(4).states[:8]
    assert vehicle.text.startswith("schema = 1")


def test_inertia_about_the_centre_of_gravity_is_moved_to_the_origin() -> None:
    """I_o = I_g - m S(r_g)^2."""
    text = EVERY_TERM.replace("r_g =", 'inertia_about = "centre-of-gravity"\nr_g =', 1)
    r = np.array([0.01, -0.005, 0.02])
    S = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    about = np.array(tomllib.loads(text)["body"]["inertia"]) - 30.0 * S @ S
    p = vehicle_from_toml(text, where="v.toml").parameters
    names = [["x", "xy", "xz"], ["xy", "y", "yz"], ["xz", "yz", "z"]]
    found = [[p[f"inertia.{name}"] for name in row] for row in names]
    assert np.array(found) == pytest.approx(about)


def test_hoerners_curve_is_read_between_its_points() -> None:
    """The section of a round hull, B/2T = 1/2, as in MSS; and one for each plane."""
    text = EVERY_TERM.replace("height = 0.2", "height = 0.25", 1)
    p = vehicle_from_toml(text, where="v.toml").parameters
    expected = np.interp(0.5, [0.4933, 0.5585], [1.2108, 1.0836])
    assert p["cross_flow.drag_sway"] == pytest.approx(expected, rel=1e-12)
    assert p["cross_flow.drag_sway"] == p["cross_flow.drag_heave"]
    assert every_term().parameters["cross_flow.drag_heave"] == pytest.approx(
        np.interp(0.4, [0.3530, 0.4519], [1.8976, 1.7872]), rel=1e-12
    )


FAULTS = [
    # what replaces what, the line that begins so, words of the message
    ("mass = 30.0", "mass = -1", "mass", "greater than 0"),
    ("mass = 30.0", "masss = 30.0", "masss", "did you mean mass?"),
    ("length = 1.6", "", "[cross_flow]", "the hull has no length"),
    ("density = 1025.0", "", "[body]", "'body.density' is missing"),
    ("weight = 294.0", "weight = 30.0", "weight", "forces in newton"),
    ("buoyancy = 297.0", "buoyancy = 30.0", "buoyancy", "far from the weight"),
    ("[0.01, 3.5, 0.015]", "[0.02, 3.5, 0.015]", "inertia", "not symmetric"),
    ("X_udot = -1.0", "X_udot = 1.0", "X_udot", "takes mass away"),
    ("X_udot = -1.0", "Xudot = -1.0", "Xudot", "did you mean X_udot?"),
    ("K_p = -0.4", "K_p = 0.4", "K_p", "drives the motion"),
    ("N_vdot = 1.5", "", "Y_rdot", "N_vdot is the same number"),
    ("N_vdot = 1.5", "N_vdot = 1.5\nN_vu = 1.0", "N_", "the same derivative"),
    ("Y_rdot = 1.5\nN_vdot = 1.5", "Y_rdot = 21.0\nN_vdot = 21.0", "[body]", "fails at nu.r"),
    ("Y_ur = 5.0", "Y_urr = 5.0", "Y_urr", "there is no key or derivative 'Y_urr'"),
    ("Y_ur = 5.0", "Y_urd = 5.0", "Y_urd", "no key or derivative"),
    ("{ Y_v = 3.0 }", "{ Y_ur = 3.0 }", "fading", "cannot fade"),
    ("coriolis_without", 'coriolis = "given"\ncoriolis_without', "coriolis_without", "leave"),
    ("Y_ur = 5.0", "Y_ur = 5.0\nprime = true", "X_u =", "a product with u: X_uu"),
    ("Y_ur = 5.0", "Y_ur = 5.0\nreference_speed = 1.0", "reference_speed", "nothing depends"),
    ('drag = "hoerner"', "drag = [1.0, 0.0]", "drag", "coefficient is zero"),
    ("softening = 1e-6", "", "coupled", "belong together"),
    ("coupled = true\nsoftening = 1e-6", 'pitch = "opposite"', "pitch", "coupled = true"),
    ("direction = [0.0, 0.6, 0.8]", "direction = [0.0, 6.0, 8.0]", "direction", "length 10"),
    ("direction = [0.0, 0.6, 0.8]", "direction = [0, 0, 0]", "direction", "a moment alone"),
    ('name = "bow"', 'name = "Propeller"', "name", "two actuators"),
    ('name = "bow"', 'name = "a b"', "name", "a letter, then letters and digits"),
    ("area = 0.013", "", 'name = "rudder"', "the fin rudder has no area"),
    ("direction = [0.0, -1.0, 0.0]", "direction = [1.0, 0, 0]", "direction", "across x"),
    ("Z_uud = -6.0", "Z_uu = -6.0", "derivatives", "derivative of a fin"),
    ("rates = { q", "rates = { s", "rates", ""),
    ('"nu.u", "nu.v", "nu.w"', '"nu.u", "nu.x"', "measures", "there is no output 'nu.x'"),
    ("noise = [0.3, 0.3]", "noise = [0.3]", "noise", "not one noise per value"),
    ("nu.q = 0.1", "nu.q = -0.1", "nu.q", "a number > 0"),
    ("nu.q = 0.1", "eta.z = 1.0", "eta.z", "needs no bound"),
    ('states = ["eta.z"', 'states = ["eta.s"', "states", "there is no state 'eta.s'"),
    ('"fin.stern" = 1.0', '"fin.bow" = 1.0', "weights", "no state or command 'fin.bow'"),
    ("degrees_of_freedom = 6", "degrees_of_freedom = 5", "degrees_of_freedom", ""),
    ("degrees_of_freedom = 6", "degrees_of_freedom = 4", "Z_qdot", "roll or pitch"),
    ("schema = 1", "schema = 2", "", "schema version 2"),
]


@pytest.mark.parametrize(("old", "new", "at", "words"), FAULTS)
def test_what_cannot_be_is_refused_with_its_line(old: str, new: str, at: str, words: str) -> None:
    """Every check of the schema and of the numbers, by one file that breaks it."""
    assert EVERY_TERM.count(old) >= 1
    text = EVERY_TERM.replace(old, new, 1)
    error = refused(text)
    assert words in error.text()
    places = [f"v.toml:{i}" for i, line in enumerate(text.splitlines(), 1) if line.startswith(at)]
    assert not at or ":".join(str(error.where).split(":")[:2]) in places, error.text()


WORD = st.text("abcdefghijklmnopqrstuvwxyz_|", min_size=1, max_size=8)


@settings(max_examples=25)
@given(word=WORD, table=st.sampled_from([h for h in vehicle_tables() if h[0] == "["]))
def test_a_key_that_does_not_exist_is_refused_by_name_and_line(word: str, table: str) -> None:
    """In every table, whatever the word."""
    if word in vehicle_tables()[table][1]:
        return
    at = line_with(EVERY_TERM, table)
    lines = EVERY_TERM.splitlines()
    text = "\n".join([*lines[:at], f'"{word}" = 1.0', *lines[at:]])
    error = refused(text)
    assert word in error.text()
    assert f"v.toml:{at + 1}" in str(error.where)


BAD = st.sampled_from(["nan", "inf", "-inf", "true", '"1.0"', "[]", "{}", "[[1.0]]"])


@settings(max_examples=25)
@given(value=BAD, key=st.sampled_from(["mass", "X_udot", "height", "limit", "delay", "u"]))
def test_a_value_that_is_no_number_is_refused_with_its_line(value: str, key: str) -> None:
    at = line_with(EVERY_TERM, f"{key} =")
    lines = EVERY_TERM.splitlines()
    error = refused("\n".join([*lines[: at - 1], f"{key} = {value}", *lines[at:]]))
    assert f"v.toml:{at}" in str(error.where)
    assert key in error.text()


def test_a_quaternion_needs_six_degrees_of_freedom_and_the_whole_attitude() -> None:
    text = level(4).text.replace("[body]", 'attitude = "quaternion"\n[body]', 1)
    assert "v.toml:4: attitude" in str(refused(text).where)
    text = every_term("quaternion").text.replace("[hydro]", '[hydro]\ncurrent = "heading"', 1)
    assert "no heading" in refused(text).what


def test_files_of_other_kinds_and_names_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(EVERY_TERM, "utf-8")
    assert load_vehicle(path).parameters == every_term().parameters
    found = named_vehicle(str(path))
    assert found is not None
    assert found.name == "every-term"
    path.write_text("[system]\nA = [[-1.0]]\n", "utf-8")
    assert named_vehicle(str(path)) is None
    assert "this file is a system, not a vehicle" in refused(path.read_text("utf-8")).text()
    assert named_vehicle("paper") is None
    with pytest.raises(InputError, match="there is no vehicle 'remus'"):
        load_vehicle("remus")
    assert all(load_vehicle(name).text == vehicle_text(name) for name in VEHICLES)


def test_every_key_of_a_vehicle_file_says_what_it_means() -> None:
    """And its unit, where it has one."""
    tables = vehicle_tables()
    assert set(tomllib.loads(EVERY_TERM)) < {h.strip("[]") for h in tables} | {
        *tables["top of the file"][1], "schema",
    }  # fmt: skip
    for purpose, keys in tables.values():
        assert purpose
        assert all(key.text and key.value for key in keys.values())
    assert tables["[body]"][1]["mass"] == (
        "number > 0", "kg", "Dry mass m, with the water inside the hull that moves with it [kg].",
        True,
    )  # fmt: skip
    assert tables["[[fins]]"][1]["limit"].unit == "rad"
    assert math.isclose(every_term().parameters["mass"], 30.0)
