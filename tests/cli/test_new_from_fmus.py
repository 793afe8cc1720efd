"""`cosim scenario new --from FMUs`: what it writes is checked and run at once."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from cli.shell import cosim
from foreign.c_fmu import c_fmu, old

from cosim.core import InputError
from cosim.scenario import scenario_from_fmus
from cosim.trace import Trace


def foreign(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """An FMU of FMI 1.0 of another tool, with some of its variables named otherwise."""
    text = old()
    for before, after in changes:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    place = folder / name
    place.mkdir()
    made = c_fmu("old_fmi1.c", text, place)
    return made.rename(folder / f"{name}.fmu")


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """A sender of x in cm and a receiver of x in m, which sends z."""
    speed = ('name="u" valueReference="0"', 'name="speed" valueReference="0"')
    out = '<Real/><DirectDependency/></ScalarVariable><ScalarVariable name="gain"'
    foreign(tmp_path, "left", speed, (out, out.replace("<Real/>", '<Real unit="cm"/>')))
    foreign(
        tmp_path,
        "right",
        ('name="x" valueReference="1"', 'name="z" valueReference="1"'),
        ('name="u" valueReference="0"', 'name="x" valueReference="0"'),
        ('<Real start="0"/></ScalarVariable>', '<Real start="0" unit="m"/></ScalarVariable>'),
    )
    return tmp_path


def test_foreign_fmus_are_wired_and_run_at_once(two: Path) -> None:
    """A unit is converted, the experiment is the FMUs' own, the answer is the first line."""
    made = cosim("scenario", "new", "--from", "left.fmu", "right.fmu", cwd=two)
    assert made.code == 0, made.out
    lines = made.out.splitlines()
    assert lines[0] == "written: left-right.toml, 2 FMUs, 1 of 8 inputs wired"
    assert lines[1:4] == [
        "next:",
        "  cosim scenario check left-right.toml",
        "  cosim run left-right.toml",
    ]
    for command in lines[2:4]:
        assert cosim(*command.split()[1:], cwd=two).code == 0
    written = tomllib.loads((two / "left-right.toml").read_text("utf-8"))
    assert written["run"]["end"] == 2.0
    (wire,) = written["connections"]
    assert wire == {"from": "left.x", "to": "right.x", "gain": pytest.approx(0.01)}


def test_units_are_converted_in_the_run(two: Path) -> None:
    """1 m/s of a sender in cm is 0.01 of a receiver in m: against the sum of its steps."""
    assert cosim("scenario", "new", "it", "--from", "left.fmu", "right.fmu", cwd=two).code == 0
    settings = ("--set", "components.left.parameters.speed=1.0", "--set", "run.step=0.25")
    assert cosim("run", "it.toml", *settings, cwd=two).code == 0
    trace = Trace(two / "traces" / "it.mcap")
    sent, received = trace["left.x"].values, trace["right.x"].values
    assert float(sent[-1]) == pytest.approx(2.0)
    assert received.tolist() == pytest.approx((0.01 * sent).tolist())


def test_over_a_link(two: Path) -> None:
    """Every connection goes over it; two FMUs of one file are two components."""
    parts = ("left.fmu", "right.fmu", "left.fmu")
    made = cosim("scenario", "new", "lossy", "--from", *parts, "--link", "modem", "--json", cwd=two)
    assert made.code == 0, made.out
    assert made.json["fmus"] == {
        "left": "left.fmu",
        "right": "right.fmu",
        "left_2": "left.fmu",
    }
    why = {one["input"]: one["why"] for one in made.json["not_wired"]}
    assert why["right.x"] == "2 outputs fit: left.x, left_2.x"
    ran = cosim("run", "lossy.toml", "--json", cwd=two)
    assert ran.code == 0, ran.out
    pair = cosim(
        *("scenario", "new", "pair", "--link", "modem", "--json"),
        *("--from", "left.fmu", "--from", "right.fmu"),
        cwd=two,
    )
    assert pair.json["wired"] == [
        {"from": "left.x", "to": "right.x", "gain": pytest.approx(0.01), "offset": 0.0}
    ]
    ran = cosim("run", "pair.toml", "--json", cwd=two)
    assert ran.code == 0, ran.out
    assert "modem" in ran.json["links"]


def test_built_in_fmus_by_name(fmus: Path, tmp_path: Path) -> None:
    """The vehicle and its controller, over a link: what is open is said in file and output."""
    made = cosim(
        *("scenario", "new", "sub/mine", "--from", "AuvPlant", "HinfController"),
        *("--link", "acoustic", "--fmus", fmus.parent),
        cwd=tmp_path,
    )
    assert made.code == 0, made.out
    assert made.out.startswith("written: sub/mine.toml, 2 FMUs, 12 of 20 inputs wired\n")
    text = (tmp_path / "sub" / "mine.toml").read_text("utf-8")
    written = tomllib.loads(text)
    assert len(written["connect"]) == 12
    assert all(one.endswith(" : acoustic") for one in written["connect"])
    assert written["run"]["step"] == 0.05
    comments = re.findall(r"# not wired: (.*)", text)
    assert len(comments) == 8
    assert "HinfController.reference.x: no output has this name" in comments
    ran = cosim("run", "sub/mine.toml", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert ran.code == 0, ran.out
    assert ran.json["links"]["acoustic"]["dropped"] > 0


def test_algebraic_loops_are_cut_as_the_file_says(tmp_path: Path) -> None:
    """Outputs that depend on inputs at once, declared or not: the run goes, the file says how."""
    loop = (
        ('name="n" valueReference="0"', 'name="k" valueReference="0"'),
        ("<Name>n</Name>", "<Name>k</Name>"),
        ('name="m" valueReference="0"', 'name="n" valueReference="0"'),
    )
    back = (('name="m" valueReference="0"', 'name="k" valueReference="0"'),)
    foreign(tmp_path, "one", *loop)
    foreign(tmp_path, "two", *back)
    made = cosim("scenario", "new", "x", "--from", "one.fmu", "two.fmu", "--json", cwd=tmp_path)
    assert made.code == 0, made.out
    text = (tmp_path / "x.toml").read_text("utf-8")
    assert 'policy = "previous"  # cuts an algebraic loop' in text
    assert cosim("run", "x.toml", cwd=tmp_path).code == 0


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("mine", "--from", "none.fmu", "left.fmu"), "no such FMU"),
        (("a", "b", "--from", "left.fmu"), "a scenario has one name"),
        (("left.fmu", "right.fmu"), "a scenario is not named after a file of an FMU"),
        (("--from", "paper-example"), "a scenario needs a name"),
        (("a", "--link", "up"), "no FMUs to connect over it"),
        (("a", "--from", "left.fmu", "--link", "a b"), "not a valid name for a link"),
        (("a", "--from", "left.fmu", "--from", "paper-example"), "not an FMU"),
        (("a", "--from", "auv-survey", "--from", "paper-example"), "a scenario extends one other"),
    ],
)
def test_mistakes_write_nothing(two: Path, arguments: tuple[str, ...], what: str) -> None:
    """Each says what is wrong, and leaves no file behind."""
    made = cosim("scenario", "new", *arguments, "--json", cwd=two)
    assert made.code == 2
    assert made.error["what"] == what
    assert not list(two.glob("*.toml"))


def test_fmu_without_a_binary_for_this_machine_is_reported(two: Path) -> None:
    """The file is written, the exit code is that of the run that would fail."""
    from fmu.packed import files_of, pack, without  # noqa: PLC0415 - of another room

    files = files_of(two / "left.fmu")
    without("binaries/")(files)
    pack(files, two / "bare.fmu")
    made = cosim("scenario", "new", "--from", "bare.fmu", "right.fmu", cwd=two)
    assert made.code == 4
    assert "written: bare-right.toml, 2 FMUs, 1 of 8 inputs wired" in made.out
    assert "it has no binary" in made.out


def test_names_of_files_become_names_of_components(two: Path) -> None:
    """Characters that no component has are left out, and the path is that of the file."""
    (two / "left.fmu").rename(two / "3 left & more.fmu")
    made = scenario_from_fmus("x", [two / "3 left & more.fmu", two / "right.fmu"], folder=two)
    assert made.fmus == {"fmu_3_left_more": "3 left & more.fmu", "right": "right.fmu"}
    assert made.problems == ()
    with pytest.raises(InputError, match="no such FMU"):
        scenario_from_fmus("x", [two / "left.fmu"], folder=two)
