"""Parts that are there several times: `count`, `each`, `[[for]]`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from cli.shell import SCENARIOS

from cosim.core import InputError, Origin
from cosim.scenario import ScenarioPart, load, open_source
from cosim.study import Study, plan_of

TEXT = (SCENARIOS / "valid" / "copies.toml").read_text("utf-8")


def out(folder: Path, **data: Any) -> tuple[dict[str, Any], Origin]:
    """What a file with these tables is written out, and what locates its parts."""
    path = folder / "copied.toml"
    path.write_text(tomli_w.dumps(data), "utf-8")
    return open_source(str(path)).written_out()


def test_copies_are_the_scenario_written_out() -> None:
    """Names, numbers, quantities and what one copy has of its own; in the order of the copies."""
    found = load(str(SCENARIOS / "valid" / "copies.toml"))
    data = found.scenario.to_data()
    assert list(data["components"]) == [
        *("drone_1", "drone_2", "alpha", "alpha_ctl", "bravo", "bravo_ctl")
    ]
    assert data["components"]["drone_2"]["parameters"] == {
        "initial.eta.y": 40,
        "initial.eta.z": 7.0,
    }
    assert data["components"]["bravo"]["parameters"] == {"initial.eta.z": "10 m"}
    assert data["links"]["bravo_up"] == {"kind": "packet", "sample_time": 0.2, "seed": 102}
    assert data["connect"] == [
        "alpha.eta -> alpha_ctl.eta : alpha_up",
        "alpha_ctl.force -> alpha.force",
        "bravo.eta -> bravo_ctl.eta : bravo_up",
        "bravo_ctl.force -> bravo.force",
    ]
    assert [one["target"] for one in data["reference"]] == [
        "alpha_ctl.reference",
        "bravo_ctl.reference",
    ]
    assert [one["always"] for one in data["assertions"]] == [
        "drone_1.eta.y > 19.9 m and drone_2.eta.y > 39.9 m and drone_2.eta.z > 6.9 m",
        "abs(alpha.eta.z - 5 m) < 3 m",
        "abs(bravo.eta.z - 10 m) < 3 m",
    ]
    # what stands in the trace reads back as the same, and so does the data in Python
    assert ScenarioPart.model_validate(tomllib.loads(found.text)) == found.scenario
    assert ScenarioPart.model_validate(tomllib.loads(TEXT)) == found.scenario


def test_setting_changes_one_copy_or_their_number(tmp_path: Path) -> None:
    path = SCENARIOS / "valid" / "copies.toml"
    settings = ["components.drone[1].parameters.initial.eta.z=3", "components.drone.count=3"]
    parts = load(str(path), settings).scenario.components
    assert parts["drone_1"].parameters["initial.eta.z"] == 3
    assert parts["drone_3"].parameters == {"initial.eta.y": 60}
    (tmp_path / "more.toml").write_text(
        f'extends = "{path}"\n[components.drone]\ncount = 4\n[components.alpha.parameters]\n'
        '"initial.eta.x" = 2.0\n'
    )
    more = load(str(tmp_path / "more.toml")).scenario.components
    assert "drone_4" in more
    assert more["alpha"].parameters == {"initial.eta.z": "5 m", "initial.eta.x": 2.0}


def test_line_and_copy_of_a_part_are_known() -> None:
    path = SCENARIOS / "valid" / "copies.toml"
    _, origin = open_source(str(path)).written_out()
    lines = TEXT.splitlines()

    def found(*key: str | int) -> tuple[str, str]:
        place = origin.place(key) or ""
        line, _, copy = place.removeprefix(f"{path}:").partition(" ")
        return lines[int(line) - 1], copy

    assert found("links", "bravo_up", "seed") == ('seed = "{100 + i}"', "(copy 'bravo')")
    assert found("components", "drone_1", "fmu") == ('fmu = "AuvPlant"', "(copy 1)")
    assert found("components", "drone_2", "parameters", "initial.eta.z") == (
        '"initial.eta.z" = 7.0',
        "",
    )
    assert found("assertions", 2, "always")[1] == "(copy 'bravo')"
    assert "abs({v}" in found("assertions", 2, "always")[0]
    assert found("events", 0, "when")[0].startswith('when = "{v}_up')
    assert found("assertions", 0, "always")[0].startswith('always = "drone_1')


def test_loops_inside_loops_and_braces(tmp_path: Path) -> None:
    """The inner loop knows the outer one's names; a doubled brace is one."""
    inner = {"count": 2, "as": "k", "connect": ["{a}_{k}.y -> {a}_{k - 1 + i}.{{u}}"]}
    loops = {"for": [{"each": ["p", "q"], "as": "a", "for": [inner]}]}
    assert out(tmp_path, **loops)[0]["connect"] == [
        "p_1.y -> p_1.{u}",
        "p_2.y -> p_3.{u}",
        "q_1.y -> q_1.{u}",
        "q_2.y -> q_3.{u}",
    ]
    named, _ = out(tmp_path, components={"p{each}x": {"fmu": "F", "each": [3, 4.5]}})
    assert named["components"] == {"p3x": {"fmu": "F"}, "p4.5x": {"fmu": "F"}}


def test_copies_add_to_one_table(tmp_path: Path) -> None:
    """Of a table whose name is the same in each copy they are parts, behind those of the file."""
    tries = {
        "count": 2,
        "modes": {
            "grab": {
                "states": {"try_{i}": {"enter": {"stop": "{i}"}}},
                "transitions": [{"from": "try_{i}", "to": "try_{i + 1}"}],
            }
        },
    }
    own = {"grab": {"states": {"try_3": {}}, "transitions": [{"to": "try_1"}]}}
    data, origin = out(tmp_path, modes=own, **{"for": [tries]})
    assert data["modes"]["grab"] == {
        "states": {"try_3": {}, "try_1": {"enter": {"stop": 1}}, "try_2": {"enter": {"stop": 2}}},
        "transitions": [
            {"to": "try_1"},
            {"from": "try_1", "to": "try_2"},
            {"from": "try_2", "to": "try_3"},
        ],
    }
    path, _, place = (origin.place(("modes", "grab", "transitions", 2)) or "").rpartition(":")
    line, _, copy = place.partition(" ")
    assert path == str(tmp_path / "copied.toml")
    assert copy == "(copy 2)"
    assert "try_{i + 1}" in "".join(Path(path).read_text("utf-8").splitlines()[int(line) - 1 :][:3])


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"components": {"a": {"count": 0}}}, "from 1 to 10000"),
        ({"components": {"a": {"count": True}}}, "from 1 to 10000"),
        ({"components": {"a": {"count": 2, "each": ["b"]}}}, "one of count and each"),
        ({"components": {"a": {"each": []}}}, "a list of names"),
        ({"components": {"a": {"each": ["b"], "as": "not one"}}}, "not the name of a placeholder"),
        ({"for": [{"each": ["b"]}]}, "repeats nothing"),
        ({"for": [{"each": ["b"], "title": "{each}"}]}, "'title' is not repeated"),
        ({"for": {"each": ["b"]}}, "a list of tables"),
        ({"for": [{"count": 2, "links": {"up": {"delay": 1}}}]}, "two copies give links.up.delay"),
        ({"for": [{"count": 1, "connect": ["{1 / 0}"]}]}, "there is no value here"),
        ({"for": [{"each": ["b"], "connect": ["{each + 1}"]}]}, "each is not a number"),
        ({"for": [{"each": [{"v": [1]}], "connect": ["x{v}"]}]}, "is not a word or a number"),
    ],
)
def test_loop_without_a_meaning_is_refused(
    data: dict[str, Any], words: str, tmp_path: Path
) -> None:
    """The words say what is missing, and where."""
    with pytest.raises(InputError) as refused:
        out(tmp_path, **data)
    assert words in str(refused.value)


def test_study_varies_one_copy(native_fmus: Path) -> None:
    """By its number in brackets or by its name."""
    loaded = load(str(SCENARIOS / "valid" / "copies.toml"))
    base = loaded.scenario
    place = "components.drone[2].parameters.initial.eta.z"
    vary = [{"kind": "grid", "path": place, "values": [7.0, 9.0]}]
    study = Study.model_validate(
        {
            "title": "one copy",
            "scenario": "copies.toml",
            "vary": vary,
            "metrics": {"z": {"signal": "drone_2.eta.z", "reduce": "final"}},
        }
    )
    plan = plan_of(study, loaded, fmus=native_fmus.parent)
    varied = plan.runner.variations.scenario(plan.runner.points[1])
    assert varied.components["drone_2"].parameters["initial.eta.z"] == 9.0
    assert varied.components["drone_1"] == base.components["drone_1"]
