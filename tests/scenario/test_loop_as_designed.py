"""What stands in a loop beside its design is named before it flies: by place, part by part."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from shared import sampled

from cosim.hinf import Result
from cosim.hinf.certificate import pair_from_json
from cosim.scenario import (
    FmuCache,
    PreparedScenario,
    Problem,
    execute_unrecorded,
    load,
    parse,
    prepare,
)

Data = dict[str, Any]


def data_of(name: str) -> Data:
    library = files("cosim.scenario").joinpath("library", f"{name}.toml")
    return tomllib.loads(library.read_text("utf-8"))


def wire(data: Data, target: str) -> Data:
    """The connection to an input."""
    found: Data = next(c for c in data["connections"] if c["to"] == target)
    return found


def departures(data: Data, native_fmus: Path, folder: Path) -> set[str]:
    """The places where the loop is not as designed, as a run of a moment names them."""
    data["run"]["end"] = 0.5
    loaded = parse(tomli_w.dumps(data), name="s", where="s.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(native_fmus.parent, folder, flavour="native"))
    metrics = execute_unrecorded(prepared, zero_state_run=False)[0].metrics
    found = metrics.get("departures", ())
    return {one["place"] for one in found if one["assumption"].endswith("_as_designed")}


def with_gain(data: Data) -> None:
    wire(data, "telemetry.u[1]")["gain"] = 2.0


def with_gain_behind(data: Data) -> None:
    wire(data, "controller.usbl")["gain"] = 2.0


def with_link_before(data: Data) -> None:
    wire(data, "usbl.u[1]")["link"] = "slow"
    data["links"]["slow"] = {"kind": "transport", "delay": 0.1}


def rounded(data: Data) -> None:
    data["links"][wire(data, "controller.usbl")["link"]]["quantization"] = 0.1


def by_another_link(data: Data) -> None:
    data["links"]["other"] = dict(data["links"][wire(data, "controller.usbl")["link"]])
    wire(data, "controller.usbl")["link"] = "other"


def computed_stamp(data: Data) -> None:
    data["computed"] = {"clock": {"now": "t / (1 s) * 1"}}
    wire(data, "controller.stamp.usbl").update({"from": "clock.now"})


def swapped(data: Data) -> None:
    one, other = wire(data, "usbl.u[1]"), wire(data, "usbl.u[2]")
    one["from"], other["from"] = other["from"], one["from"]


def biased(data: Data) -> None:
    data["components"]["usbl"]["parameters"]["bias[1]"] = 0.1


def noisier(data: Data) -> None:
    data["components"]["usbl"]["parameters"]["noise[1]"] = 0.6


def other_thrust(data: Data) -> None:
    data["components"]["controller"]["parameters"]["thrust_map[1,1]"] = 0.0


def shorter_delay(data: Data) -> None:
    data["components"]["plant"]["parameters"]["delay.d"] = 0.1


def current(data: Data) -> None:
    data["components"]["plant"]["parameters"]["current.x"] = 0.2


def follows_the_loop(data: Data) -> None:
    data["connections"] = [c for c in data["connections"] if c["to"] != "plant.disturbance"]
    data["computed"] = {"push": {"u": "plant.nu.u / (1 s)"}}
    data["connections"].append({"from": "push.u", "to": "plant.disturbance.u"})


OBSERVED: list[tuple[Callable[[Data], None], set[str]]] = [
    (lambda _: None, set()),
    (with_gain, {"telemetry.u[1]"}),
    (with_gain_behind, {"controller.usbl[1]", "controller.usbl[2]"}),
    (with_link_before, {"usbl.u[1]"}),
    (rounded, {"controller.usbl[1]", "controller.usbl[2]", "controller.stamp.usbl"}),
    (by_another_link, {"controller.usbl[1]", "controller.usbl[2]"}),
    (computed_stamp, {"controller.stamp.usbl"}),
    (swapped, {"usbl.u[1]", "usbl.u[2]"}),
    (biased, {"usbl.bias[1]"}),
    (noisier, {"usbl.noise[1]"}),
    (other_thrust, {"controller.thrust_map[1,1]"}),
    (shorter_delay, {"plant.delay.d"}),
    (current, {"plant.current.x"}),
    (follows_the_loop, {"plant.disturbance.u"}),
]


@pytest.mark.parametrize(
    ("change", "places"),
    sampled(OBSERVED, 5),
    ids=lambda x: getattr(x, "__name__", "").strip("<>"),
)
def test_each_part_beside_the_design_is_named(
    change: Callable[[Data], None], places: set[str], native_fmus: Path, tmp_path: Path
) -> None:
    """Of a loop with an observer: what is measured, its sensors, numbers, and what acts."""
    data = data_of("auv-remote")
    change(data)
    assert departures(data, native_fmus, tmp_path) == places


def test_a_value_beyond_the_last_one_is_named(native_fmus: Path, tmp_path: Path) -> None:
    """The policy "linear" goes on where nothing was sent."""
    data = data_of("survey-outages")
    wire(data, "controller.eta")["policy"] = "linear"
    places = {f"controller.eta.{axis}" for axis in ("x", "y", "z", "psi")}
    assert departures(data, native_fmus, tmp_path) == places


def test_commands_of_a_constant_age_cover_no_run(native_fmus: Path) -> None:
    """However young they are; of any age they may be as old as is proved, and no nanosecond more.

    The design claims another thing than is proved: what a run asks of the claim is looked at.
    """
    loaded = load("auv-remote", ["run.end=3"])
    cache = FmuCache(native_fmus.parent, loaded.folder, flavour="native")
    proved = prepare(loaded, cache)
    measured = commands(proved)[0]
    for any_age, name in (
        (False, "age_of_commands_constant"),
        (True, "age_of_commands_within_design"),
    ):
        for age_s, met in ((measured, any_age), (measured - 1e-9, False)):
            saved = claiming_commands(proved, age_s, any_age=any_age)
            _, assumptions = commands(prepare(loaded, cache, saved=saved))
            assert {x for x in assumptions if x.startswith("age_of_commands")} == {name}
            assert assumptions[name] is met


def commands(prepared: PreparedScenario) -> tuple[float, dict[str, bool]]:
    """The greatest age of a command in a run [s], and which assumptions were met."""
    metrics = execute_unrecorded(prepared, zero_state_run=False)[0].metrics
    age: float = metrics["measurement_ages"]["commands"]["measured"]["greatest_s"]
    return age, metrics["assumptions"]


def claiming_commands(
    prepared: PreparedScenario, age_s: float, *, any_age: bool
) -> tuple[Problem, Result]:
    """The problem, and its design with another claim about the age of its commands."""
    assert prepared.problem is not None
    assert prepared.design is not None
    data = json.loads(json.dumps(prepared.design.certificate))
    data |= {"command_age": age_s, "command_any_age": any_age}
    observer = pair_from_json(data)
    return prepared.problem, replace(prepared.design, observer=observer, certificate=data)


@pytest.mark.parametrize("at_point", [8190, 8191, 8192])
def test_an_altered_value_is_found_wherever_it_is(
    at_point: int, native_fmus: Path, tmp_path: Path
) -> None:
    """For one point of a long run, over a link that delays nothing: whatever is read at once."""
    data = data_of("auv-worst-case")
    data["run"] |= {"end": 90.0, "step": 0.01}
    for link in data["links"].values():
        link["delay"] = 0.0
    at, until = at_point / 100, (at_point + 1) / 100
    data["events"] = [{"at": at, "until": until, "override": {"plant.force.x": 3.0}}]
    loaded = parse(tomli_w.dumps(data), name="long", where="long.toml", folder=tmp_path)
    prepared = prepare(loaded, FmuCache(native_fmus.parent, tmp_path, flavour="native"))
    found = execute_unrecorded(prepared)[0].to_json()["metrics"]["departures"]
    altered = [one for one in found if one["assumption"] == "values_delivered"]
    assert [(one["place"], one["at_s"]) for one in altered] == [("plant.force.x", at)]
