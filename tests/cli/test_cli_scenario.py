"""`cosim scenario`: list, new, check, show, schema; what extends and what is set."""

from __future__ import annotations

import tomllib
from pathlib import Path

from cli.shell import cosim


def test_new_scenario_is_valid_and_runs(fmus: Path, tmp_path: Path) -> None:
    """A template without and with a base: both pass the check, the first one flies."""
    for arguments in (("mine",), ("slower", "--from", "auv-acoustic")):
        made = cosim("scenario", "new", *arguments, "--json", cwd=tmp_path)
        assert made.code == 0
        file = made.json["file"]
        checked = cosim("scenario", "check", file, "--fmus", fmus.parent, cwd=tmp_path)
        assert checked.code == 0, checked.out
    ran = cosim("run", "mine.toml", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert ran.code == 0
    assert ran.json["assertions"][0]["result"] == "holds"
    again = cosim("scenario", "new", "mine", "--json", cwd=tmp_path)
    assert (again.code, again.error["where"]) == (2, "mine.toml")
    assert cosim("scenario", "new", "a b", "--json", cwd=tmp_path).code == 2


def test_show_is_the_whole_scenario(tmp_path: Path) -> None:
    """What it extends is in it, what is set too; units are resolved; the file is right TOML."""
    (tmp_path / "mine.toml").write_text(
        'extends = "auv-acoustic"\nwithout = ["reference"]\n[run]\nend = "1 min"\n'
        '[links.uplink]\nkind = "transport"\ndelay = "0.3 s"\n'
    )
    displayed = cosim(
        *("scenario", "show", "mine.toml", "--set", "links.downlink.loss=5 %"),
        *("--set", "components.plant.parameters.initial.eta.x=2.5"),
        cwd=tmp_path,
    )
    data = tomllib.loads(displayed.out)
    assert data["run"] == {"end": 60.0, "step": 0.05, "seed": 7, "events": "align"}
    assert data["links"]["uplink"] == {"kind": "transport", "delay": 0.3}
    assert data["links"]["downlink"]["loss"] == 0.05
    assert data["components"]["plant"]["parameters"]["initial.eta.x"] == 2.5
    assert "reference" not in data
    assert len(data["connections"]) == 5
    as_json = cosim("scenario", "show", "mine.toml", "--json", cwd=tmp_path).json
    assert as_json["content"]["run"]["end"] == 60.0


def test_wrong_setting_is_named(tmp_path: Path) -> None:
    """The setting itself is the place of the fault."""
    for text, words in (
        ("links.uplink.dely=1", "--set links.uplink.dely=1"),
        ("run.end=soon", "--set run.end=soon"),
        ("run.end", "KEY=VALUE"),
        ("run.end=[1", "as in TOML"),
        ("connections[9].link=x", "there is no place 9"),
    ):
        result = cosim("scenario", "show", "auv-acoustic", "--set", text, "--json", cwd=tmp_path)
        assert result.code == 2
        assert words in result.err


def test_diagrams_name_every_part(tmp_path: Path) -> None:
    """Components, links and connections, as text and as Mermaid."""
    text = cosim("scenario", "show", "auv-acoustic", "--diagram", "text", cwd=tmp_path).out
    assert "plant.eta         --(uplink)--> controller.eta" in text
    chart = cosim("scenario", "show", "auv-acoustic", "--diagram", "mermaid", cwd=tmp_path).out
    assert chart.startswith("flowchart LR")
    for words in ("AuvPlant", "uplink<br/>packet each 0.15 s", '-->|"eta, nu"|'):
        assert words in chart


def test_schema_is_valid_and_list_is_complete(tmp_path: Path) -> None:
    """JSON Schema by its own rules; every listed scenario can be shown."""
    import jsonschema  # noqa: PLC0415 - two seconds, where it has grammars of addresses to compile

    schema = cosim("scenario", "schema", cwd=tmp_path).json
    jsonschema.Draft202012Validator.check_schema(schema)
    rows = cosim("scenario", "list", "--json", cwd=tmp_path).json["scenarios"]
    assert {"name", "title", "description", "assertions"} <= set(rows[0])
    assert len(rows) >= 15
    assert cosim("scenario", "list", cwd=tmp_path).code == 0
