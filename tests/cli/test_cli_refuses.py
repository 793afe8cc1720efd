"""What every verb says when it cannot do what was asked."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from cli.shell import SCENARIOS, cosim, trace_of

PLAIN = SCENARIOS / "valid" / "plain.toml"

USAGE = [
    ["--json"],
    ["frobnicate", "--json"],
    ["run", "--json"],
    ["run", "auv-acoustic", "--ot", "x", "--json"],
    ["run", "auv-acoustic", "extra", "--json"],
    ["scenario", "list", "extra", "--json"],
    ["design", "--json"],
    ["design", "paper", "--gamma", "much", "--json"],
    ["trace", "--json"],
    ["fmu", "controller", "--json"],
    ["trace", "info", "--json"],
    ["trace", "frobnicate", "--json"],
]


@pytest.mark.parametrize("arguments", USAGE, ids=" ".join)
def test_usage_errors_are_json_too(arguments: list[str], tmp_path: Path) -> None:
    """A verb, option or argument that does not exist: exit 2, one JSON object, where to look."""
    result = cosim(*arguments, cwd=tmp_path)
    assert result.code == 2
    assert result.error["hint"].endswith("--help")


DESIGNS = [
    (["papr"], 2, "did you mean paper?"),
    (["nope.toml"], 2, "cannot be read"),
    (["folder.toml"], 2, "cannot be read"),
    (["plain"], 2, "there is no system"),
    (["paper", "--k1", "a"], 2, "--k1: not a list of numbers"),
    (["paper", "--k1", ""], 2, "--k1: not a list of numbers"),
    (["paper", "--k1", "0.6,0.6"], 2, "1 finite number, one per delay"),
    (["paper", "--k1", "nan"], 2, "1 finite number, one per delay"),
    (["paper", "--k1", "1e400"], 2, "1 finite number, one per delay"),
    (["paper", "--k2", "0"], 2, "k2 must not be zero"),
    (["auv", "--k2", "1.0"], 2, "2 finite numbers, one per delay"),
    (["paper", "--gamma", "nan"], 2, "gamma must be a positive number"),
    (["paper", "--gamma", "-1"], 2, "gamma must be a positive number"),
    (["paper", "--gamma", "5"], 5, "no gamma <= ||D1|| = 5 exists"),
    (
        ["paper", "--gamma", "5.005", "--k1", "0.6", "--k2", "0.2", "--order", "theorem-2"],
        5,
        "gamma >= 5.0132",
    ),
    (["paper", "--order", "-1"], 2, "not an order"),
    (["paper", "--order", "13"], 2, "not an order"),
    (["paper", "--save", "folder.toml"], 2, "the output is a folder"),
]


@pytest.mark.parametrize(("arguments", "code", "message"), DESIGNS, ids=str)
def test_design_refuses(arguments: list[str], code: int, message: str, tmp_path: Path) -> None:
    """A system, scalar or bound that cannot be: the message names it, the code says which kind."""
    (tmp_path / "folder.toml").mkdir()
    result = cosim("design", *arguments, "--json", cwd=tmp_path)
    assert result.code == code
    assert message in result.err
    assert result.error["what"]


def test_scenario_without_design_has_none(tmp_path: Path) -> None:
    """`design FILE.toml` takes systems; a scenario's file is told apart by its keys."""
    result = cosim("design", PLAIN, "--json", cwd=tmp_path)
    assert result.code == 2
    assert "this file is a scenario, not a system" in result.error["what"]


TRACES = {
    "missing": (2, "cannot be opened"),
    "empty": (2, "empty"),
    "text": (2, "not an MCAP file"),
    "folder": (2, "not a trace"),
    "cut": (3, "cut short or damaged"),
    "flipped": (3, "cut short or damaged"),
}


@pytest.mark.parametrize("kind", TRACES)
def test_rerun_refuses_an_incomplete_trace(kind: str, tmp_path: Path) -> None:
    """Missing, empty, something else: bad input; cut or damaged: loss. Never a traceback."""
    code, message = TRACES[kind]
    path = tmp_path / "t.mcap"
    whole = trace_of("paper-example").read_bytes()
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        flipped = bytearray(whole)
        flipped[len(whole) // 2] ^= 0xFF
        contents = {"empty": b"", "text": b"title = 1\n" * 9, "cut": whole[: len(whole) // 2]}
        path.write_bytes(contents.get(kind, bytes(flipped)))
    result = cosim("trace", "rerun", path, "--json", cwd=tmp_path)
    assert result.code == code
    assert message in result.error["what"]
    reported = cosim("trace", "info", path, "--json", cwd=tmp_path)
    if code == 3:
        assert reported.code == 0
        assert reported.json["complete"] is False
        assert reported.json["damage"]
    else:
        assert reported.code == 2
        assert message in reported.error["what"]


@pytest.mark.parametrize("cut", [1, 8, 9, 20, 200, 5000, -1, -9, -100])
def test_info_reads_a_trace_cut_anywhere(cut: int, tmp_path: Path) -> None:
    """However short it is, what is readable is told, or that nothing is."""
    path = tmp_path / "t.mcap"
    path.write_bytes(trace_of("paper-example").read_bytes()[:cut])
    result = cosim("trace", "info", path, "--json", cwd=tmp_path)
    if result.code:
        assert result.code in (2, 3)
        assert result.error["what"]
    else:
        assert result.json["complete"] is False


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", str(PLAIN), "--out", "file/t.mcap"],
        ["run", str(PLAIN), "--out", "folder"],
        ["run", str(PLAIN), "--out", "/proc/none/t.mcap"],
        ["run", str(PLAIN), "--fmus", "file"],
        ["run", str(PLAIN), "--fmus", "/proc/none"],
        ["run", "folder"],
        ["run", "latin.toml"],
        ["run", "no/such.toml"],
        ["run", ""],
    ],
    ids=" ".join,
)
def test_paths_that_cannot_be_used(arguments: list[str], fmus: Path, tmp_path: Path) -> None:
    """Unwritable, unreadable, a directory, not UTF-8: bad input that names the path."""
    (tmp_path / "file").write_text("a file")
    (tmp_path / "folder").mkdir()
    (tmp_path / "latin.toml").write_bytes('title = "Später"\n'.encode("latin-1"))
    if "--fmus" not in arguments:
        arguments = [*arguments, "--fmus", str(fmus.parent)]
    result = cosim(*arguments, "--json", cwd=tmp_path)
    assert result.code == 2
    assert result.error["where"]
    assert "unexpected" not in result.error["what"]


def test_unreadable_file_is_named(tmp_path: Path) -> None:
    """A file without permission to read: bad input."""
    path = tmp_path / "s.toml"
    shutil.copy(PLAIN, path)
    path.chmod(0)
    try:
        path.read_text()
    except PermissionError:
        result = cosim("run", path, "--json", cwd=tmp_path)
        assert result.code == 2
        assert "s.toml" in result.error["where"]
    else:
        pytest.skip("this user may read everything")


def test_scenario_with_a_fault_is_refused(tmp_path: Path) -> None:
    """A mistyped name comes back with the names that exist, nearest first."""
    result = cosim("run", "auv-acoustc", "--json", cwd=tmp_path)
    assert result.code == 2
    assert "did you mean auv-acoustic" in result.error["hint"]


WITHOUT_B = """
[system]
A = [[-5.0, 0.0], [6.0, -10.0]]
C = [[4.0], [3.0]]
D = [[-1.0, 0.0], [0.0, -1.0]]
"""


@pytest.mark.parametrize(
    ("command", "where", "what"),
    [
        (["design", "open.toml"], "open: B", "B is missing"),
        (["design", "open.toml", "--max-delay", "--gamma", "6"], "open: B", "B is missing"),
        (["analyse", "open.toml", "--gain", "[[1, 2]]"], "open: B", "B is missing"),
        (["design", "d2.toml"], "d2.toml:2: system", "B: expected shape (2, 1) beside D2"),
        (["analyse", "d2.toml"], "d2.toml:2: system", "B: expected shape (2, 1) beside D2"),
        (["fmu", "build", "d2.toml", "-o", "x.fmu"], "d2.toml:2: system", "got no B"),
    ],
    ids=str,
)
def test_a_system_without_b(command: list[str], where: str, what: str, tmp_path: Path) -> None:
    """A forgotten B is no matrix of zeros: it is named, and nothing is made."""
    (tmp_path / "open.toml").write_text(WITHOUT_B, "utf-8")
    (tmp_path / "d2.toml").write_text(WITHOUT_B + "D2 = [[3.0], [-1.0]]\n", "utf-8")
    error = cosim(*command, "--json", cwd=tmp_path).error
    assert error["exit_code"] == 2
    assert error["where"] == where
    assert what in error["what"]
    assert not (tmp_path / "x.fmu").exists()


def test_a_saved_system_without_b(tmp_path: Path) -> None:
    """As JSON, in a design's file: the same words."""
    cosim("design", "paper", "--k1", "0.6", "--k2", "0.2", "--save", "c.json", cwd=tmp_path)
    data = json.loads((tmp_path / "c.json").read_text("utf-8"))
    del data["system"]["B"]
    (tmp_path / "c.json").write_text(json.dumps(data), "utf-8")
    error = cosim("fmu", "controller", "c.json", "--json", cwd=tmp_path).error
    assert error["exit_code"] == 2
    assert "B: expected shape (2, 1) beside D2, which weighs u; got no B" in error["what"]
