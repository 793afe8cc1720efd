"""What stands in a loop beside its design is named before it flies: by place, part by part."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from shared import sampled

from cosim import hinf
from cosim.models import Measurement
from cosim.scenario import FmuCache, parse, prepare
from cosim.scenario.execute import assembled_system, loop_beside_design
from cosim.scenario.guarantee.ages import command_findings

Data = dict[str, Any]


def data_of(name: str) -> Data:
    library = files("cosim.scenario").joinpath("library", f"{name}.toml")
    return tomllib.loads(library.read_text("utf-8"))


def wire(data: Data, target: str) -> Data:
    """The connection to an input."""
    found: Data = next(c for c in data["connections"] if c["to"] == target)
    return found


def departures(data: Data, native_fmus: Path, folder: Path) -> set[str]:
    """The places where the loop is not as designed."""
    loaded = parse(tomli_w.dumps(data), name="s", where="s.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(native_fmus.parent, folder, flavour="native"))
    compared = loop_beside_design(prepared, assembled_system(prepared)[0])
    assert compared is not None
    apart = [x.place for x in (*compared.departures, *compared.sensors)]
    numbers = [
        f"{name}.{x.parameter}" for name, found in compared.differences.items() for x in found
    ]
    return {*apart, *numbers}


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


def test_commands_of_a_constant_age_cover_no_run() -> None:
    """However young they are."""
    system = hinf.DelaySystem([[-1.0]], [[1.0]])
    measured = [Measurement("x", [[1.0]], 0.1, any_age=True)]
    for late, name in (
        (False, "age_of_commands_constant"),
        (True, "age_of_commands_within_design"),
    ):
        found = hinf.design_output_feedback(
            *(system, measured),
            gain=[[-0.1]],
            injections=[[[0.1]]],
            command_age=0.1,
            command_any_age=late,
        )
        for age, met in ((100_000_000, late), (100_000_001, False)):
            apart = command_findings(found.pair, age, "")
            assert set(apart) == {name}
            assert (not apart[name]) is met
