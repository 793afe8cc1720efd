"""No verb prints a name of others, of a file or in a file, so that it steers the terminal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.commands import every_command
from cli.shell import SCENARIOS, cosim
from shared import sampled, spread

from cosim.vehicle import vehicle_text

STEERING = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e[/red]"
"""A title, a cleared screen, a colour of C1, text turned round, and markup that never began."""
SUFFIXES = (".toml", ".json", ".fmu", ".mcap", ".csv", ".ssp", ".parquet", "")


WITH_FILES = {
    found.words: found.command
    for found in every_command()
    if found.is_leaf
    and any(p.param_type_name == "argument" for p in found.command.params)
    and found.path[-1] != "play"
}


def line(verb: str, name: str) -> list[str]:
    """The command with this name for every argument and every option that is required."""
    words = verb.split()
    for parameter in WITH_FILES[verb].params:
        if parameter.param_type_name == "argument":
            words.append(name)
        elif parameter.required:
            words += [parameter.opts[0], name]
    return words


def test_the_list_of_verbs_is_whole() -> None:
    """Those of groups, and those that are loaded when used, are among them."""
    known = {"run", "certificate check", "trace verify", "trace rerun", "fmu check", "link verdict"}
    assert {*known, "study run", "vehicle check", "ssp import", "migrate"} <= {*WITH_FILES}
    assert len(WITH_FILES) > 35


@pytest.mark.parametrize("verb", sampled(spread(sorted(WITH_FILES), 3), 15))
def test_a_verb_prints_no_escape_of_a_files_name(verb: str, tmp_path: Path) -> None:
    """Missing, empty, or of another kind: refused by name, without what steers the terminal."""
    tries = [
        ("", None),
        (".toml", None),
        (".toml", b""),
        *((suffix, b'{"kind": 1}') for suffix in SUFFIXES),
    ]
    for suffix, content in tries:
        name = f"a{STEERING}{suffix}".replace("/", "\u2215")
        if content is not None:
            (tmp_path / name).write_bytes(content)
        result = cosim(*line(verb, name), cwd=tmp_path)
        harmless(result.out + result.err)
        assert "unexpected" not in result.err, (suffix, content)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scenario, a design, a vehicle, an FMU, a trace and a recording, all of steering names."""
    title = json.dumps(STEERING).strip('"').replace("\\u202e", "\u202e")
    plain = (SCENARIOS / "valid" / "plain.toml").read_text("utf-8")
    vehicle = vehicle_text("nps-auv2")
    files = {
        "toml": plain.replace('title = "', f'title = "{title} ', 1),
        "vehicle.toml": vehicle.replace('description = "', f'description = "{title} ', 1),
        "csv": f"sent,delivered,node\n0,1,{STEERING}\n2,,{STEERING}\n",
    }
    for suffix, text in files.items():
        (tmp_path / hostile(suffix)).write_text(text, "utf-8")
    for words in (
        ("design", "paper", "--save", hostile("json")),
        ("fmu", "build", "paper", "-o", hostile("fmu")),
        ("run", hostile("toml"), "-o", hostile("mcap")),
    ):
        made = cosim(*words, cwd=tmp_path)
        assert made.code == 0, made.err
        harmless(made.out + made.err)
    return tmp_path


def hostile(suffix: str) -> str:
    """The name of a file of this kind."""
    return f"a{STEERING}.{suffix}".replace("/", "\u2215")


@pytest.mark.slow
def test_sound_files_of_such_names_are_read_and_printed_harmlessly(folder: Path) -> None:
    """What the verbs show of them, too: titles, sources, nodes, places of findings."""
    scenario, trace, vehicle = hostile("toml"), hostile("mcap"), hostile("vehicle.toml")
    for words in (
        ("scenario", "check", scenario),
        ("scenario", "show", scenario),
        ("trace", "info", trace),
        ("trace", "verify", trace),
        ("trace", "cite", trace),
        ("trace", "diff", trace, trace),
        ("trace", "export", trace, "-o", f"c{hostile('csv')}"),
        ("certificate", "check", hostile("json")),
        ("vehicle", "check", vehicle),
        ("vehicle", "show", vehicle),
        ("link", "show", hostile("csv")),
        ("fmu", "check", hostile("fmu")),
        ("fmu", "info", hostile("fmu")),
        ("ssp", "export", scenario, "-o", hostile("ssp")),
        ("ssp", "import", hostile("ssp"), "-o", "imported"),
    ):
        result = cosim(*words, cwd=folder)
        assert result.code == 0, (words, result.err)
        harmless(result.out + result.err)


def harmless(printed: str) -> None:
    """Nothing in it steers a terminal."""
    steering = [c for c in printed if (not c.isprintable() and c not in "\n\t") or c == "\u202e"]
    assert not steering, printed
