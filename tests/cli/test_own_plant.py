"""A user's own plant and controller: TOML, design, two FMUs, a flight; held to true solutions."""

from __future__ import annotations

import html
import json
import math
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from shared import copied, made_once, sampled
from truth.dde import Hold, Solution, solve

from cosim.fmu.export import component_module
from cosim.trace import Trace

SYSTEM = """
[system]
A = [[0.0, 1.0, 0.0], [-1.0, -0.8, 0.2], [0.0, 0.3, -0.8]]
B = [[0.0], [1.0], [0.5]]
C = [[0.0], [1.0], [0.0]]
D = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
D2 = [[0.0], [0.5]]
E = [[0.0], [0.3], [0.0]]
H = [[0.5, 0.0, 0.2], [0.0, 0.4, 0.0]]

[[system.delays]]
d = 0.4
A = [[0.0, 0.0, 0.0], [-0.3, 0.0, 0.1], [0.0, 0.0, -0.2]]
H = [[0.1, 0.0, 0.0], [0.0, 0.0, 0.3]]

[[system.delays]]
d = 0.7
A = [[0.0, 0.1, 0.0], [0.0, -0.2, 0.0], [0.1, 0.0, 0.0]]

[[system.delays]]
d = 1.0
feedback = true
any_age = true

[design]
k1 = [-0.5, -0.5, -0.5]
k2 = [0.5, 0.5, 0.5]
"""
INITIAL = (1.0, 0.0, -0.5)
FLAVOURS = ("native", "python")
EVERY = (*FLAVOURS, "native-fmi3")

LOOP = """
title = "My plant, my controller"
[run]
end = 3.0
step = 0.25
[components.plant]
fmu = "{flavour}/my-plant.fmu"
[components.controller]
fmu = "{flavour}/my-controller.fmu"
[[connections]]
from = "plant.x"
to = "controller.x"
link = "uplink"
[[connections]]
from = "controller.u"
to = "plant.u"
[links.uplink]
kind = "transport"
delay = 0.25
[design]
system = "my-system.toml"
gain = {gain}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a user has after three commands: a design, plant and controller, of every flavour."""
    return copied(made_once("own-plant", fill), tmp_path_factory.mktemp("own") / "folder")


def fill(folder: Path) -> None:
    """Give the commands, once per session."""
    (folder / "my-system.toml").write_text(SYSTEM, "utf-8")
    assert cosim("design", "my-system.toml", "--save", "my-design.json", cwd=folder).code == 0
    for flavour in EVERY:
        common = ("--flavour", flavour, "--json")
        start = ",".join(map(str, INITIAL))
        made(folder, "build", "my-system.toml", "-o", f"{flavour}/my-plant.fmu", *common, start)
        path = f"{flavour}/my-controller.fmu"
        result = cosim(
            "fmu", "controller", "my-design.json", "-o", path, "--sample-time", "0.5", *common,
            cwd=folder,
        )  # fmt: skip
        assert result.code == 0, result.err


def made(folder: Path, verb: str, *arguments: str) -> Any:
    """Give the JSON of `cosim fmu build`, whose last argument is the initial state."""
    *rest, start = arguments
    result = cosim("fmu", verb, *rest, "--initial", start, cwd=folder)
    assert result.code == 0, result.err
    return result.json


def truth(u: Hold, w: Hold, end: float, amplitude: float = 0.0, omega: float = 0.0) -> Solution:
    """Integrate the numbers of SYSTEM by other means than the code under test."""
    system = tomllib.loads(SYSTEM)["system"]
    A, B, C, E, H = (np.array(system[letter]) for letter in "ABCEH")
    first, second, _ = system["delays"]

    def rate(t: float, x: np.ndarray, late: list[np.ndarray]) -> np.ndarray:
        F = np.array([[amplitude * math.sin(omega * t), 0.0]])
        uncertain = E @ F @ (H @ x + np.array(first["H"]) @ late[0])
        known = A @ x + np.array(first["A"]) @ late[0] + np.array(second["A"]) @ late[1]
        return np.asarray(known + uncertain + B[:, 0] * u(t) + C[:, 0] * w(t))

    return solve(rate, INITIAL, [0.4, 0.7], end, switches=[*u.times, *w.times])


@pytest.mark.slow
@pytest.mark.parametrize("flavour", sampled(EVERY, 1))
def test_the_plant_is_the_solution_of_its_equation(folder: Path, flavour: str) -> None:
    """By FMPy: two delays, a rectangular F(t), inputs that jump; x and z to eight digits."""
    columns = [("time", float), ("u[1]", float), ("w[1]", float)]
    rows = [(0.0, 0.5, 0.0), (1.0, 0.5, 0.0), (1.0, -0.7, 1.0), (3.0, -0.7, 1.0)]
    result = simulate_fmu(
        str(folder / flavour / "my-plant.fmu"),
        stop_time=3.0,
        output_interval=0.25,
        input=np.array(rows, columns),
        start_values={"solver.step": 0.005, "F.amplitude": 0.8, "F.omega": 2.0},
        output=["x[1]", "x[2]", "x[3]", "z[1]", "z[2]"],
    )
    u, w = Hold([0.0, 1.0], [0.5, -0.7]), Hold([0.0, 1.0], [0.0, 1.0])
    exact = truth(u, w, 3.0, 0.8, 2.0).sample(result["time"])
    got = np.column_stack([result[f"x[{i}]"] for i in (1, 2, 3)])
    np.testing.assert_allclose(got, exact, atol=2e-8)
    assert np.abs(exact[-1] - truth(u, w, 3.0)(3.0)).max() > 1e-2  # F(t) is felt
    np.testing.assert_array_equal(result["z[1]"], result["x[1]"])
    np.testing.assert_allclose(result["z[2]"][[1, -1]], [0.25, -0.35], rtol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("flavour", sampled(FLAVOURS, 1))
def test_plant_and_controller_run_from_their_paths(folder: Path, flavour: str) -> None:
    """A scenario names both files: the flight is u = K x, sampled, late, through the equation."""
    K = json.loads((folder / "my-design.json").read_text())["K"]
    (folder / "loop.toml").write_text(LOOP.format(flavour=flavour, gain=K), "utf-8")
    ran = cosim("run", "loop.toml", "--out", f"{flavour}.mcap", "--json", cwd=folder)
    assert ran.code == 0, ran.err
    # a link of constant delay: the gain is proved for what it justifies
    assumptions = ran.json["metrics"]["assumptions"]
    assert {"message_age_not_below_least", "message_age_sampled"} <= set(assumptions)
    assert all(assumptions.values())
    trace = Trace(folder / f"{flavour}.mcap")
    inputs, x = trace.read("/plant/input"), trace.read("/plant/output")
    command, seen = trace.read("/controller/output"), trace.read("/controller/input")
    # sampled at 0, 0.5, ..., commanded from the point after, held over two
    expected = K[0] @ np.array([seen[f"x[{j}]"] for j in (1, 2, 3)])
    np.testing.assert_allclose(command["u[1]"][1::2], expected[:-1:2], rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(command["u[1]"][2::2], command["u[1]"][1:-1:2])
    # the link's delay and the exchange: what is seen is two points old
    np.testing.assert_array_equal(seen["x[1]"][2:], x["x[1]"][1:-1])
    u = Hold([0.0, *(0.25 + 0.5 * k for k in range(6))], [0.0, *inputs["u[1]"][1::2]])
    exact = truth(u, Hold([0.0], [0.0]), 3.0).sample(x.log_time_ns / 1e9)
    got = np.column_stack([x[f"x[{i}]"] for i in (1, 2, 3)])
    np.testing.assert_allclose(got, exact, atol=1e-6)
    assert np.abs(np.diff(u.values)).max() > 0.05


@pytest.mark.slow
def test_another_plant_is_not_as_designed(folder: Path) -> None:
    """One entry or one delay more, and the guarantee is not claimed.

    For a shorter delay it is: the proof is about constant delays up to these. It is one scenario,
    so that what was proved for its first run is kept for the others.
    """
    K = json.loads((folder / "my-design.json").read_text())["K"]
    for parameter, as_designed in (
        ('"delay.d2" = 0.7', True),
        ('"A2[1,2]" = 0.1000001', False),
        ('"delay.d2" = 0.71', False),
        ('"delay.d2" = 0.6', True),
    ):
        text = LOOP.format(flavour="native", gain=K)
        text = text.replace("[components.controller]", f"parameters = {{ {parameter} }}\n\\g", 1)
        text = text.replace("\\g", "[components.controller]")
        (folder / "loop.toml").write_text(text, "utf-8")
        ran = cosim("run", "loop.toml", "--json", cwd=folder)
        assert ran.code == 0, ran.err
        assert ran.json["metrics"]["assumptions"]["plant_as_designed"] is as_designed


@pytest.mark.parametrize("flavour", sampled(EVERY, 1))
@pytest.mark.parametrize("name", ["my-plant", "my-controller"])
def test_each_fmu_passes_other_checkers(folder: Path, name: str, flavour: str) -> None:
    """`cosim fmu check --run` finds nothing, FMPy's validation neither."""
    path = folder / flavour / f"{name}.fmu"
    checked = cosim("fmu", "check", path, "--run", "--time", "600", "--json", cwd=folder)
    assert checked.code == 0, checked.out
    assert {found["level"] for found in checked.json["findings"]} == {"note"}
    assert validate_fmu(str(path)) == []


def test_both_flavours_take_the_same_steps(folder: Path) -> None:
    """Native and Python plant, bit by bit."""
    runs = [
        simulate_fmu(
            str(folder / flavour / "my-plant.fmu"),
            stop_time=2.0,
            output_interval=0.1,
            start_values={"u[1]": 0.3, "w[1]": -1.0, "F.amplitude": 1.0},
        )
        for flavour in FLAVOURS
    ]
    assert runs[0].dtype == runs[1].dtype
    assert runs[0].tobytes() == runs[1].tobytes()


def test_variables_start_with_the_numbers_of_the_file(folder: Path) -> None:
    """Every entry of every matrix under its name, in both versions of FMI; no link's delay."""
    system = tomllib.loads(SYSTEM)["system"]
    first, second, _ = system["delays"]
    wanted = {letter: system[letter] for letter in ("A", "B", "C", "D", "D2", "E", "H")}
    wanted |= {"A1": first["A"], "H1": first["H"], "A2": second["A"]}
    wanted |= {"D1": [[0.0], [0.0]], "H2": [[0.0] * 3] * 2}
    for version in ("native", "native-fmi3"):
        model = read_model_description(str(folder / version / "my-plant.fmu"))
        start = {v.name: float(v.start) for v in model.modelVariables if v.start is not None}
        for letter, matrix in wanted.items():
            entries = {
                f"{letter}[{i},{j}]": value
                for i, row in enumerate(matrix, 1)
                for j, value in enumerate(row, 1)
            }
            assert entries == {n: v for n, v in start.items() if n.startswith(f"{letter}[")}
        delays = {n: v for n, v in start.items() if n.startswith("delay")}
        assert delays == {"delay.d1": 0.4, "delay.d2": 0.7}
        assert [start[f"x[{i}]"] for i in (1, 2, 3)] == list(INITIAL)
        assert [start[f"z[{i}]"] for i in (1, 2)] == [1.0, 0.0]


@pytest.mark.slow
@pytest.mark.parametrize("flavour", sampled(["native", "native-fmi3", "python"], 1))
def test_twice_gives_the_same_bytes(folder: Path, flavour: str) -> None:
    """One system, one name, one file; what is said is what is done."""
    arguments = ("my-system.toml", "--flavour", flavour, "--json", "0,0,0")
    reply = made(folder, "build", *arguments[:1], "-o", "a/same.fmu", *arguments[1:])
    made(folder, "build", *arguments[:1], "-o", "b/same.fmu", *arguments[1:])
    assert (folder / "a" / "same.fmu").read_bytes() == (folder / "b" / "same.fmu").read_bytes()
    assert reply == {
        "fmu": "a/same.fmu",
        "model": "same",
        "flavour": flavour,
        "sizes": {"x": 3, "u": 1, "w": 1, "z": 2},
        "delays": {"delay.d1": 0.4, "delay.d2": 0.7},
        "feedback_delay": 1.0,
        "solver_step": 0.05,
    }


SMALL = {
    "nothing but A": ("A = [[-0.5]]", []),
    "one delay": ("A = [[-0.5]]\nA1 = [[-1.0]]\nd = 1.0", ["delay.d"]),
    "no state of its own": ("A = [[0.0]]\nA1 = [[-1.0]]\nd = 1.0\nD1 = [[1.0]]", ["delay.d"]),
    "an output of inputs alone": ("A = [[-0.5]]\nB = [[1.0]]\nD2 = [[2.0]]", []),
    "the link's delay alone": (
        "A = [[-0.5]]\nB = [[1.0]]\n[[system.delays]]\nd = 0.5\nfeedback = true",
        [],
    ),
    "a link's delay with a matrix": (
        "A = [[-0.5]]\nB = [[1.0]]\n[[system.delays]]\nd = 1.0\nA = [[-1.0]]\nfeedback = true",
        ["delay.d"],
    ),
    "an uncertainty": ("A = [[-0.5]]\nE = [[1.0]]\nH = [[0.1]]", []),
}


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("name", sampled(SMALL, 2))
def test_absent_matrices_give_no_variables(tmp_path: Path, name: str, flavour: str) -> None:
    """Sizes of zero, no delays; a solution in closed form: exp, or the method of steps."""
    text, delays = SMALL[name]
    (tmp_path / "s.toml").write_text(f"[system]\n{text}\n", "utf-8")
    reply = made(tmp_path, "build", "s.toml", "--flavour", flavour, "--json", "1")
    assert list(reply["delays"]) == delays
    names = {v.name for v in read_model_description(str(tmp_path / "s.fmu")).modelVariables}
    assert ("F.amplitude" in names) is (name == "an uncertainty")
    result = simulate_fmu(
        str(tmp_path / "s.fmu"),
        stop_time=2.0,
        output_interval=0.5,
        start_values={"solver.step": 0.01},
        output=["x[1]"],
    )
    a = -0.5 if "-0.5" in text else 0.0
    exact = [closed_form(t, a, -1.0 if delays else 0.0) for t in result["time"]]
    np.testing.assert_allclose(result["x[1]"], exact, rtol=1e-9, atol=1e-10)


def closed_form(t: float, a: float, b: float) -> float:
    """Solve x' = a x + b x(t-1), history 1, by hand for t <= 2, a in {0, -1/2}."""
    if not b:
        return math.exp(a * t)
    if a == 0.0:
        return 1 - t if t <= 1 else 1 - t + (t - 1) ** 2 / 2
    # first interval: x' = -x/2 - 1, x = 3 exp(-t/2) - 2
    if t <= 1:
        return 3 * math.exp(-t / 2) - 2
    s = t - 1  # x' = -x/2 - 3 exp(-s/2) + 2: x = (c - 3 s) exp(-s/2) + 4
    c = 3 * math.exp(-0.5) - 2 - 4
    return (c - 3 * s) * math.exp(-s / 2) + 4


def large(n: int, delays: int) -> str:
    """Text of a system of this size, stable by its diagonal."""
    generator = np.random.default_rng(n)
    lines = ["[system]", f"A = {(generator.normal(size=(n, n)) - 4 * n * np.eye(n)).tolist()}"]
    for letter, shape in (
        ("B", (n, 3)),
        ("C", (n, 2)),
        ("D", (n, n)),
        ("E", (n, 2)),
        ("H", (3, n)),
    ):
        lines.append(f"{letter} = {generator.normal(size=shape).tolist()}")
    for k in range(delays):
        lines += ["[[system.delays]]", f"d = {0.1 * (k + 1)}"]
        lines += [f"A = {generator.normal(size=(n, n)).tolist()}"]
        lines += [f"H = {generator.normal(size=(3, n)).tolist()}"]
    return "\n".join(lines)


@pytest.mark.slow
def test_twelve_states_with_three_delays_build_and_run(tmp_path: Path) -> None:
    """Some 1500 parameters; the generated C grows with the entries and no faster."""
    sizes = []
    for n in (6, 12):
        (tmp_path / f"s{n}.toml").write_text(large(n, 3), "utf-8")
        made(tmp_path, "build", f"s{n}.toml", "--json", ",".join(["1"] * n))
        with zipfile.ZipFile(tmp_path / f"s{n}.fmu") as archive:
            model = archive.read("sources/model.c").decode()
            sizes.append(len(model[model.index("void model_rates") :]))
    assert sizes[1] < 4.4 * sizes[0]
    result = simulate_fmu(str(tmp_path / "s12.fmu"), stop_time=0.5, output_interval=0.01)
    assert np.isfinite(result["x[12]"]).all()


@pytest.mark.slow
def test_built_in_systems_build_by_name(tmp_path: Path) -> None:
    """`paper` is DelayedPlant under another name: the same variables, numbers, steps."""
    assert cosim("fmu", "build", "paper", cwd=tmp_path).code == 0
    model = read_model_description(str(tmp_path / "paper.fmu"))
    spec = component_module("delayed_plant.variables").SPEC

    listed = [(v.name, float(v.start)) for v in model.modelVariables]
    assert listed == [(v.name, v.start) for v in spec.variables]
    reply = made(tmp_path, "build", "auv", "-o", "v.fmu", "--json", ",".join("0" * 8))
    assert reply["sizes"]["x"] == 8
    assert list(reply["delays"].values()) == [0.5]
    assert reply["feedback_delay"] == 1.25


def programs(page: str, language: str) -> list[str]:
    """Blocks of a page in one language."""
    pattern = f'<pre><code class="language-{language}">(.*?)</code></pre>'
    return [html.unescape(found) for found in re.findall(pattern, page, re.DOTALL)]


def test_what_the_pages_show_runs(folder: Path) -> None:
    """The FMPy program and the scenario of a user's own plant and controller, as they stand."""
    for name in ("plant", "controller"):  # what the pages call them
        displayed = folder / "shown"
        displayed.mkdir(exist_ok=True)
        content = (folder / "native" / f"my-{name}.fmu").read_bytes()
        (displayed / f"{name}.fmu").write_bytes(content)
        (displayed / f"my_{name}.fmu").write_bytes(content)
    for name in ("plant", "controller"):
        with zipfile.ZipFile(displayed / f"{name}.fmu") as archive:
            page = archive.read("documentation/index.html").decode()
        (program,) = programs(page, "python")
        done = subprocess.run(  # noqa: S603 - what the page tells people to type
            [sys.executable, "-c", program],
            cwd=displayed,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert len(done.stdout.split()) == 2
        (scenario,) = programs(page, "toml")
        (displayed / f"{name}.toml").write_text(scenario, "utf-8")
        ran = cosim("run", f"{name}.toml", "--json", cwd=displayed)
        assert ran.code == 0, ran.err
        assert ran.json["status"] == "finished"
        assert ("transport" in scenario) is True


def test_the_page_says_where_each_delay_is(folder: Path) -> None:
    """Two in the plant under their names; that of the feedback between plant and controller."""
    with zipfile.ZipFile(folder / "native" / "my-plant.fmu") as archive:
        page = archive.read("documentation/index.html").decode()
    rows = re.findall(r"<tr>\s*<td>([\d.]+ s)</td>\s*<td>(.*?)</td>", page, re.DOTALL)
    assert [d for d, _ in rows] == ["0.4 s", "0.7 s", "1 s"]
    assert "delay.d1" in rows[0][1]
    assert "delay.d2" in rows[1][1]
    assert "<strong>not</strong> in this FMU" in rows[2][1]


def test_text_output_shows_what_was_exported(folder: Path) -> None:
    """Without --json: the file, its sizes, and where the delays are."""
    seen = cosim("fmu", "build", "my-system.toml", "-o", "seen.fmu", "--name", "Seen", cwd=folder)
    assert seen.code == 0
    for word in ("seen.fmu", "Seen", "FMI 2.0, native", "delay.d2", "0.7 s", "of the link"):
        assert word in seen.out


def test_help_of_build_explains_parameters(tmp_path: Path) -> None:
    """Names of variables, the flavours, what becomes of a delay of the feedback."""
    out = cosim("fmu", "build", "--help", cwd=tmp_path).out
    for word in ("A1[i,j]", "delay.d1", "native-fmi3", "feedback", "--initial", "--platforms"):
        assert word in out


REFUSED = [
    (["absent.toml"], "cannot be read"),
    (["nosuch"], "there is no system"),
    (["broken.toml"], "malformed TOML"),
    (["my-system.toml", "--initial", "1,2"], "the initial state does not fit"),
    (["my-system.toml", "--initial", "1,2,inf"], "the initial state does not fit"),
    (["my-system.toml", "--initial", "a"], "not a list of numbers"),
    (["my-system.toml", "--name", "two words"], "this is no model name"),
    (["my-system.toml", "--name", "class"], "this is no model name"),
    (["my-system.toml", "--name", "x" * 81], "this is no model name"),
    (["my-system.toml", "-o", "é.fmu"], "gives no model name"),
    (["my-system.toml", "-o", "my-system.toml"], "would overwrite"),
    (["my-system.toml", "-o", "/proc/none/x.fmu"], "the FMU cannot be written"),
    (["my-system.toml", "--flavour", "fortran"], "Invalid value"),
    (["my-system.toml", "--platforms", "vax"], "there is no platform"),
    (["my-system.toml", "--flavour", "python", "--platforms", "all"], "no platforms of its own"),
]


@pytest.mark.parametrize(("arguments", "reply"), REFUSED, ids=str)
def test_what_cannot_be_built_is_refused(arguments: list[str], reply: str, folder: Path) -> None:
    """Exit 2, in words, and no file; the system's file stays what it was."""
    (folder / "broken.toml").write_text("[system\n", "utf-8")
    before = set(folder.rglob("*.fmu"))
    result = cosim("fmu", "build", *arguments, "--json", cwd=folder)
    assert result.code == 2
    assert reply in result.error["what"]
    assert set(folder.rglob("*.fmu")) == before
    assert (folder / "my-system.toml").read_text("utf-8") == SYSTEM


@pytest.mark.parametrize("verb", ["build", "controller"])
def test_no_compiler_is_an_error_that_names_a_way_out(
    verb: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is built in silence as something else."""
    monkeypatch.setenv("CC", "no-such-compiler")
    given = {"build": "my-system.toml", "controller": "my-design.json"}[verb]
    result = cosim("fmu", verb, given, "-o", "none.fmu", "--json", cwd=folder)
    assert result.code == 2
    assert "need a C compiler" in result.error["what"]
    assert "--flavour python" in result.error["hint"]
    assert not (folder / "none.fmu").exists()


@pytest.mark.slow
def test_one_file_for_several_platforms(folder: Path) -> None:
    """Named platforms are cross-compiled, into the folders of FMI 2.0."""
    pytest.importorskip("ziglang")
    command = ("fmu", "build", "my-system.toml", "-o", "several.fmu", "--platforms")
    assert cosim(*command, "x86_64-windows,aarch64-linux", cwd=folder).code == 0
    with zipfile.ZipFile(folder / "several.fmu") as archive:
        binaries = {n.split("/", 1)[1] for n in archive.namelist() if n.startswith("binaries/")}
    assert binaries == {"win64/several.dll", "aarch64-linux/several.so"}
