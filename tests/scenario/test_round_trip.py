"""A written scenario reads back equal; a mistyped one is refused."""

from __future__ import annotations

import copy
import json
import shutil
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from cli.shell import SCENARIOS, cosim
from hypothesis import HealthCheck, given, settings, strategies as st

from cosim.core import CosimError, InputError
from cosim.scenario import (
    FmuCache,
    ScenarioPart,
    builtin_names,
    json_schema,
    load,
    open_source,
    parse,
    problems_of,
    run,
)

VALID = sorted(map(str, (SCENARIOS / "valid").glob("*.toml")))
EVERY = [*builtin_names(), *VALID]


@pytest.mark.parametrize("name", EVERY, ids=lambda name: Path(name).stem)
def test_written_scenario_reads_back_equal(name: str, tmp_path: Path) -> None:
    """Through TOML and through JSON, equal in every field, and the text is then its own image."""
    scenario = load(name).scenario
    text = scenario.to_toml()
    again = parse(text, name="again", where="again.toml", folder=tmp_path).scenario
    assert again == scenario
    assert again.to_toml() == text
    data = json.loads(json.dumps(scenario.model_dump(by_alias=True, exclude_none=True)))
    assert ScenarioPart.model_validate(data) == scenario


@cache
def editor() -> Any:
    """What checks a file as an editor does; the schema itself is checked first, once."""
    import jsonschema  # noqa: PLC0415 - two seconds, where it has grammars of addresses to compile

    schema = json_schema()
    validator = jsonschema.validators.validator_for(schema)
    validator.check_schema(schema)
    return validator(schema)


@pytest.mark.parametrize("name", EVERY, ids=lambda name: Path(name).stem)
def test_json_schema_accepts_valid_files(name: str) -> None:
    """The JSON Schema accepts every file that the reader accepts, extending or not."""
    editor().validate(tomllib.loads(open_source(name).text))


def test_json_schema_refuses_invalid_files() -> None:
    """An unknown key, a time of another form, a missing table; less in what extends."""
    data = tomllib.loads(open_source("auv-direct").text)
    for change in ({"colour": 1}, {"run": {"end": "soon", "step": 1.0}}):
        assert not editor().is_valid(data | change)
    del data["run"]
    assert not editor().is_valid(data)
    editor().validate({"extends": "auv-direct", "run": {"seed": 2}})


def test_scenario_built_in_python_runs(fmus: Path, tmp_path: Path) -> None:
    """The same scenario as objects: same content hash as from its file, and rerun."""
    scenario = ScenarioPart.model_validate(
        {
            "title": "built",
            "run": {"end": 1.0, "step": "100 ms"},
            "components": {
                "plant": {"fmu": "DelayedPlant"},
                "controller": {"fmu": "PaperController"},
            },
            "connect": ["plant.x -> controller.x", "controller.u -> plant.u"],
            "events": [{"when": "plant.x[1] < 5", "for": 0.2, "override": {"plant.u[1]": 1.0}}],
            "assertions": [{"eventually": "plant.x[1] < 5"}],
        }
    )
    path = tmp_path / "scenario.toml"
    path.write_text(scenario.to_toml())
    built = run(scenario, tmp_path / "a.mcap", fmus=fmus.parent)
    read = run(str(path), str(tmp_path / "b.mcap"), fmus=str(fmus.parent))
    assert built.content_hash == read.content_hash
    assert built.assertions[0].result == "holds"
    again = cosim("trace", "rerun", "a.mcap", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert again.json["identical"] is True


PIECES: list[Any] = [
    *(None, True, -1, 0, 1e308, float("nan"), float("inf"), 10**400, "", "5 m", "-3 s", "x.y"),
    *(
        "plant.eta.z > 5",
        "((",
        "a -> b",
        [],
        [[]],
        {},
        {"kind": "packet"},
        [{"at": 1}],
        "\0",
        "\u00e9",
    ),
    *("9" * 50, {"offset": "1 m"}, ["plant"], {"plant.x[1]": [1]}, "1e999 s", "jacobi", "_"),
]


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inside = data.items() if isinstance(data, dict) else enumerate(data)
    found = [path]
    for key, value in inside:
        at = (*path, key)
        found += places(value, at) if isinstance(value, dict | list) else [at]
    return found


def mutated(data: dict[str, Any], draw: Any) -> dict[str, Any]:
    data = copy.deepcopy(data)
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from([p for p in places(data) if p]))
        here: Any = data
        for key in path[:-1]:
            here = here[key]
        what = draw(st.sampled_from(["replace", "remove", "add", "rename"]))
        if what == "remove":
            del here[path[-1]]
        elif what == "add" and isinstance(here, dict):
            key = draw(
                st.sampled_from(["at", "when", "for", "link", "x", "a.b", "events", "within"])
            )
            here[key] = copy.deepcopy(draw(st.sampled_from(PIECES)))
        elif what == "rename" and isinstance(here, dict):
            here[f"{path[-1]}x"] = here.pop(path[-1])
        else:
            here[path[-1]] = copy.deepcopy(draw(st.sampled_from(PIECES)))
        if not data:
            break
    return data


SEEDS = [tomllib.loads(Path(name).read_text("utf-8")) for name in VALID]


@pytest.mark.slow
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_every_mutation_runs_or_gives_a_message(
    data: st.DataObject, fmus: Path, tmp_path: Path
) -> None:
    """Values of every wrong kind in every place: refused in words, or right; never a traceback."""
    shutil.copytree(SCENARIOS / "valid", tmp_path, dirs_exist_ok=True)
    tables = mutated(data.draw(st.sampled_from(SEEDS)), data.draw)
    try:
        text = tomli_w.dumps(tables)
    except (TypeError, ValueError):  # None, and what is no text
        text = tomli_w.dumps({k: v for k, v in tables.items() if isinstance(v, str)})
    try:
        (tmp_path / "m.toml").write_text(text, "utf-8")
        source = open_source(str(tmp_path / "m.toml"))
    except CosimError:
        return
    for problem in problems_of(source, FmuCache(fmus.parent, tmp_path)):
        assert isinstance(problem, CosimError)
        assert problem.what


@settings(max_examples=300)
@given(
    text=st.text(alphabet="plant.et>< =()[]'\"0123456789 msandort*/+-^%!,_:\\\n\u00b5", max_size=40)
)
def test_every_text_is_a_condition_or_gives_a_message(text: str) -> None:
    """Any letters: a condition, or a message with a column."""
    data = tomllib.loads(Path(VALID[0]).read_text("utf-8"))
    data["events"] = [{"when": text, "stop": True}]
    refused = []
    try:
        parse(tomli_w.dumps(data), name="m", where="m.toml", folder=Path())
    except InputError as error:
        refused.append(error.text())
    assert all("events[0].when" in words and "column" in words for words in refused)
