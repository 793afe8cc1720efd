"""Mistakes of those who come from control, simulation and marine robotics, and what they are told.

Each answer names the key, the file or the command that was needed; none points elsewhere.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim

SYSTEM = """[system]
A = [[-5.0, 0.0], [6.0, -10.0]]
A1 = [[-1.0, 0.0], [2.0, 1.0]]
B = [[-1.0], [3.0]]
d = 0.3
"""
LOOP = """title = "t"
[run]
end = 1.0
step = 0.01
[components.plant]
fmu = "my-plant.fmu"
"""
LINK = 'extends = "auv-acoustic"\n[links.uplink]\n'

IN_SYSTEMS = {
    ("[system]\n", ""): "put the line [system] above",
    ("B = [[-1.0], [3.0]]", "B = [-1.0, 3.0]"): "a column is [[4.0], [3.0]]",
    ("B = [[-1.0], [3.0]]", "B = [[-1.0, 3.0]]"): "one row per state",
    ("[6.0, -10.0]]", "[6.0]]"): "rows of a matrix differ in length",
    ("B =", "B1 ="): "C, the matrix of the disturbance w, or B",
    ("d = 0.3", "tau = 0.3"): "the delay is d, in seconds",
    ("d = 0.3", 'd = "300 ms"'): "0.3 for 300 ms",
    ("d = 0.3", "d = 300 ms"): "a number with its unit is written in quotes",
    ("d = 0.3", "d = 3/10"): "write the result of the calculation",
    ("d = 0.3", "d = 0.3\nk1 = [0.6]"): "did you mean design.k1?",
    ("d = 0.3", "d = 0.3\n[design]\nA = [[1.0]]"): "did you mean system.A or",
    ("A1 = [[-1.0, 0.0], [2.0, 1.0]]\nB", "B"): "feedback = true, any_age = true",
    ("A1 = [[-1.0, 0.0], [2.0, 1.0]]\n", "[system.delays]\n"): "double brackets",
}
IN_SCENARIOS = {
    ('"my-plant.fmu"', '"my-plant"'): "did you mean my-plant.fmu?",
    ('"my-plant.fmu"', '"my-plnt.fmu"'): "did you mean my-plant.fmu?",
    ('"my-plant.fmu"', '"pump.fmu"'): "starts from the folder of its file",
    ('"my-plant.fmu"', '"fmus/AuvPlant.fmu"'): 'fmu = "AuvPlant"',
    ("end = 1.0", "stopTime = 1.0"): "did you mean end?",
    ("step = 0.01", "dt = 0.01"): "did you mean step?",
    ("step = 0.01", "step = 0.01\nrandom_seed = 3"): "did you mean seed?",
    ("fmu =", "path ="): "did you mean fmu?",
    ("title", "system = 's.toml'\ntitle"): "did you mean design.system?",
    ("[components.", "[component."): "did you mean components?",
    ("\n[components", "\n[design]\nA = [[1.0]]\n[components"): 'system = "my-system.toml"',
    ('.fmu"\n', '.fmu"\nparameters = { initial.x = 1.0 }\n'): '"initial.x" = ...',
    (LOOP, f"{LINK}latency = 0.4\n"): "did you mean delay?",
    (LOOP, f"{LINK}packet_loss = 0.1\n"): "did you mean loss?",
    (LOOP, f"{LINK}loss = 5\n"): '"5 %" is 5 in a hundred',
    (LOOP, LINK.replace("uplink", "acoustic") + "delay = 1\n"): "uplink, downlink",
    (LOOP, 'extends = "loop"\n'): "did you mean loop.toml?",
    (LOOP, SYSTEM): "this file is a system, not a scenario",
    (LOOP, "extends = 'auv-acoustic'\n[[events]]\nat = 1.0\noutage = 'uplink'\n"): '["uplink"]',
}
COMMANDS = {
    ("run", "s.toml"): "cosim design s.toml",
    ("run", "my-plant.fmu"): "cosim fmu check my-plant.fmu --run",
    ("run", "gain.json"): '[design] file = "gain.json"',
    ("run", "t.mcap"): "cosim trace rerun t.mcap",
    ("run", "delay-margin"): "cosim study list",
    ("run", "loop"): "did you mean loop.toml?",
    ("run", "lop.toml"): "did you mean loop.toml?",
    ("run", "auv-direct", "--stop-time", "5"): "--until",
    ("study", "run", "loop.toml"): "this file is a scenario, not a study",
    ("design", "loop.toml"): "cosim run loop.toml",
    ("design", "gain.json"): "cosim certificate check gain.json",
    ("design", "plant.mat"): "cosim.DelaySystem",
    ("fmu", "controller", "s.toml"): "cosim design s.toml --save s.json",
    ("analyse", "paper", "--gain", "[0.6, -0.5]"): '"[[0.6, -0.5]]"',
    ("age", "auv", "--bit-rate", "5 kbit/s"): "without a unit",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of a user, some of them empty."""
    folder = tmp_path_factory.mktemp("mistakes")
    for name, text in (("s.toml", SYSTEM), ("loop.toml", LOOP), ("gain.json", "{}")):
        (folder / name).write_text(text, "utf-8")
    for name in ("my-plant.fmu", "t.mcap", "plant.mat"):
        (folder / name).write_bytes(b"")
    return folder


def answer(*arguments: str, folder: Path) -> str:
    """Return what a command that must fail says."""
    result = cosim(*arguments, cwd=folder)
    assert result.code == 2, result.out
    assert "unexpected" not in result.err
    assert "build_fmu.py" not in result.err or "AuvPlant" in result.err
    return result.err


@pytest.mark.parametrize("name", ["design", "run"])
def test_a_mistake_in_a_file_is_answered(name: str, folder: Path) -> None:
    """Each in a file of its own; the answer names its line or table, and what to write."""
    cases, whole = (IN_SYSTEMS, SYSTEM) if name == "design" else (IN_SCENARIOS, LOOP)
    wrong = {}
    for (old, new), words in cases.items():
        assert old in whole
        (folder / "mine.toml").write_text(whole.replace(old, new, 1), "utf-8")
        reply = answer(name, "mine.toml", folder=folder)
        if words not in reply:
            wrong[new] = (words, reply)
    assert not wrong


def test_a_mistake_in_a_command_is_answered(folder: Path) -> None:
    """A file of another kind, a name of another list, an option of another tool."""
    replies = {line: answer(*line, folder=folder) for line in COMMANDS}
    assert {
        line: replies[line] for line, words in COMMANDS.items() if words not in replies[line]
    } == {}
