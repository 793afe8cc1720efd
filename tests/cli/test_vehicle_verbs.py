"""The verbs of vehicles: a file is written, checked, figures and flown."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.shell import cosim
from shared import fmu_store

from cosim.vehicle import VEHICLES, vehicle_text


@pytest.mark.parametrize("like", VEHICLES)
def test_a_new_vehicle_file_explains_its_keys_and_can_be_read(like: str, tmp_path: Path) -> None:
    """A copy of each of the gallery, under another name; never over a file."""
    made = cosim("vehicle", "new", "mine", "--like", like, "--json", cwd=tmp_path)
    made_of = f"written: mine.toml, a copy of {like} with a comment for every key"
    assert made.json == {"answer": made_of, "file": "mine.toml", "like": like}
    text = tmp_path.joinpath("mine.toml").read_text("utf-8")
    assert "# Dry mass m" in text
    assert '\nname = "mine"\n' in text
    figures = cosim("vehicle", "show", "mine.toml", "--json", cwd=tmp_path).json
    own = cosim("vehicle", "show", like, "--json", cwd=tmp_path).json
    assert figures["name"] == "mine"
    assert figures["mass_matrix"] == own["mass_matrix"]
    assert figures["trim"] == own["trim"]
    again = cosim("vehicle", "new", "mine", "--json", cwd=tmp_path)
    assert again.code == 2
    assert again.error["what"] == "this file already exists"


def test_every_fault_of_a_file_is_named_with_its_place(tmp_path: Path) -> None:
    """Keys of the schema first; then what the numbers cannot be, one line each."""
    cosim("vehicle", "new", "mine", "--like", "bluerov2-heavy", cwd=tmp_path)
    file = tmp_path / "mine.toml"
    text = file.read_text("utf-8")
    file.write_text(text.replace("mass = 13.5", "mass = -13.5\nlenght = 1.0"), "utf-8")
    found = cosim("vehicle", "check", "mine.toml", "--json", cwd=tmp_path)
    assert found.code == 2
    faults = [each["what"] for each in found.json["vehicles"][0]["findings"]]
    assert len(faults) == 2
    assert any("lenght" in fault for fault in faults)
    wrong = text.replace("X_u = -13.7", "X_u = 13.7").replace(
        "limit = 30.4\nlag", "limit = 30.4\n\nlag"
    )
    wrong = wrong.replace("direction = [0.0, 0.0, -1.0]", "direction = [0.0, 0.0, -2.0]", 1)
    file.write_text(wrong.replace('"X_|u|u" = -141.0', ""), "utf-8")
    found = cosim("vehicle", "check", "mine.toml", "--json", cwd=tmp_path)
    faults = [each["what"] for each in found.json["vehicles"][0]["findings"]]
    assert faults == ["X_u is positive: it drives the motion", "not a unit vector"]
    places = [each["where"] for each in found.json["vehicles"][0]["findings"]]
    assert all(place.startswith("mine.toml:") for place in places)


def test_what_is_doubtful_is_a_warning_not_an_error(tmp_path: Path) -> None:
    """The paper's vehicle leaves terms out, so that the water drives it; it can be designed for."""
    found = cosim("vehicle", "check", "nps-auv2", "--json", cwd=tmp_path)
    assert found.code == 0
    (finding,) = found.json["vehicles"][0]["findings"]
    assert finding["level"] == "warning"
    assert "drag is not dissipative" in finding["what"]


def test_a_vehicle_has_figures_and_a_picture(tmp_path: Path) -> None:
    """Mass with added mass, and poles without control: four of a hovering vehicle at zero."""
    picture = tmp_path / "rov.png"
    found = cosim(
        "vehicle", "show", "bluerov2-heavy", "--picture", picture, "--json", cwd=tmp_path
    ).json
    assert found["mass_matrix"][0][0] == pytest.approx(13.5 + 6.36)
    assert sum(abs(complex(*pole)) < 1e-4 for pole in found["poles"]) >= 4
    assert found["greatest_power_W"] == 0.0
    assert picture.stat().st_size > 10_000
    assert "[[thrusters]]" in cosim("vehicle", "show", "--keys", cwd=tmp_path).out


@pytest.mark.slow
def test_a_flight_keeps_everything_it_made_and_can_be_run_again(tmp_path: Path) -> None:
    """From a name: certified, every assumption listed and met, with scenario, trace and picture."""
    store = fmu_store()
    made = cosim(
        *("vehicle", "fly", "nps-auv2", "--link", "2s", "--duration", "60", "--json"),
        *("--out", "flight", "--fmus", store),
        cwd=tmp_path,
    )
    assert made.code == 0, made.err
    answer = made.json
    assumptions = answer["run"]["metrics"]["assumptions"]
    assert {"age_of_onboard_within_design", "age_of_usbl_within_design"} <= set(assumptions)
    assert all(assumptions.values())
    assert answer["run"]["metrics"]["gain"] <= answer["gamma"] < 2.8
    kept = {path.name for path in (tmp_path / "flight").iterdir()}
    assert kept >= {"vehicle.toml", "design.json", "scenario.toml", "flight.mcap", "flight.png"}
    checked = cosim("certificate", "check", "flight/design.json", "--json", cwd=tmp_path)
    assert json.loads(checked.out)["valid"]
    again = cosim(
        *("run", "flight/scenario.toml", "--set", "links.usbl.delay=5.0", "--json"),
        *("--fmus", store),
        cwd=tmp_path,
    ).json
    assert again["metrics"]["assumptions"]["age_of_usbl_within_design"] is False


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("length = 1.6", "length = 1e12"),
        ("length = 1.6", "length = 1.7e308"),
        ("lag = 0.1", "lag = 1e12"),
    ],
)
def test_numbers_beyond_all_vehicles_are_named(old: str, new: str, tmp_path: Path) -> None:
    """Whatever overflows or does not converge: no traceback, nothing of LAPACK on any stream."""
    text = vehicle_text("remus100")
    assert old in text
    (tmp_path / "mine.toml").write_text(text.replace(old, new))
    for verb in ("check", "show"):
        found = cosim("vehicle", verb, "mine.toml", "--json", cwd=tmp_path)
        assert found.code in (0, 2), found.err
        assert isinstance(found.json, dict)
        assert "unexpected" not in found.err
        assert "Warning" not in found.err


SLEDGE = """
name = "sledge"
degrees_of_freedom = 4
body = { mass = 100, inertia = [10, 10, 10] }
hydro = { X_udot = -10, X_u = -100 }
thrusters = [{ name = "surge", direction = [1, 0, 0], limit = 50 }]
control = { states = ["eta.x", "nu.u"] }
"""
"""A vehicle that goes ahead and back; its place comes over the link."""


def modem_log(folder: Path, count: int = 12) -> list[bool]:
    """Write modem.log: every 2 s, in milliseconds since 1970; return which were lost."""
    lost = [k % 5 == 3 for k in range(count)]
    lines = ["seq;tx;rx"]
    for k, each in enumerate(lost):
        sent = 1_714_557_600_000 + 2000 * k
        lines.append(f"{k};{sent};{'NaN' if each else sent + 700 + 10 * (k % 7)}")
    folder.joinpath("modem.log").write_text("\n".join(lines) + "\n", "utf-8")
    return lost


@pytest.mark.slow
def test_a_flight_over_a_log_does_what_was_logged(tmp_path: Path) -> None:
    """Delay and loss of each message are those of the last one that was logged by its time."""
    lost = modem_log(tmp_path)
    tmp_path.joinpath("sledge.toml").write_text(SLEDGE, "utf-8")
    given = ["vehicle", "fly", "sledge.toml", "--recording", "modem.log", "--unit", "ms"]
    given += ["--duration", "15", "--fmus", str(fmu_store("native"))]
    found = cosim(*given, "--json", cwd=tmp_path)
    assert found.code == 0
    assert found.json["recording"]["line"] == (
        "12 messages over 22 s, median delay 0.725 s, 16.7 % lost"
    )
    log = "modem.log: 12 messages over 22 s"
    assert log in found.err
    assert "the link as recorded: up to 1 message lost in a row" in found.err
    folder = tmp_path / "flights" / "sledge"
    text = folder.joinpath("scenario.toml").read_text("utf-8")
    assert text.count('recording = { file = "recording.csv", rows = "time" }') == 2
    for link in ("usbl", "set_points"):
        sent = found.json["run"]["links"][link]["sent"]
        rows = [k // 2 for k in range(sent)]  # a message each second, a row every two
        assert found.json["run"]["links"][link]["lost"] == sum(lost[row] for row in rows)
        delays = [0.7 + 0.01 * (row % 7) for row in rows if not lost[row]]
        assert found.json["run"]["links"][link]["max_delay_s"] == pytest.approx(max(delays))


def test_a_log_that_looks_wrong_is_asked_about_before_a_flight(tmp_path: Path) -> None:
    """Milliseconds read as seconds; and options that do not go together."""
    rows = [f"{2000 * k},{2000 * k + 1002 + k % 3}" for k in range(20)]
    tmp_path.joinpath("wrong.csv").write_text("\n".join(("sent,rx", *rows)) + "\n", "utf-8")
    fly = ["vehicle", "fly", "bluerov2-heavy"]
    found = cosim(*fly, "--recording", "wrong.csv", cwd=tmp_path)
    assert found.code == 2
    assert "wrong.csv: the median delay is 1,003 s: are these milliseconds?" in found.err
    assert "give --unit ms" in found.err
    assert "at least ten times the time that a message takes" in found.err
    for more, words in (
        (["--unit", "ms"], "there is no log to read"),
        (["--node", "a"], "there is no log to read"),
        (["--recording", "wrong.csv", "--loss", "0.1"], "says which messages are lost"),
    ):
        refused = cosim(*fly, *more, cwd=tmp_path)
        assert refused.code == 2
        assert words in refused.err
