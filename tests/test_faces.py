"""The faces of the packages: what they offer, what goes past them, and which way imports point."""

from __future__ import annotations

import ast
import importlib
import json
import pkgutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import cosim

ROOT = Path(cosim.__file__).parents[1]
FRONT_DOOR = {
    *("run", "open_session", "Scenario", "design", "analyse", "check_certificate", "DelaySystem"),
    *("Delay", "link", "Result", "pack", "build_fmu", "Trace", "Traces", "run_study", "sweep"),
    *("env", "Component", "scenario_of", "inject", "run_async", "RunResult", "Session"),
    *("CosimError", "__version__"),
}
LOWER = {
    "core": set(),
    "tape": {"core"},
    "models": {"core"},
    "network": {"core"},
    "page": {"core"},
    "trace": {"core", "page"},
    "recordings": {"core", "network", "trace", "hinf"},
    "hinf": {"core", "models"},
    "fmu": {"core", "tape", "models", "hinf", "network"},
    "master": {"core", "tape", "fmu", "network", "trace"},
    "scenario": {
        "core",
        "tape",
        "models",
        "network",
        "trace",
        "hinf",
        "fmu",
        "master",
        "recordings",
    },
    "replay": {"core", "models", "network", "trace", "hinf", "fmu", "master", "scenario"},
    "study": {"core", "models", "network", "page", "trace", "hinf", "fmu", "master", "scenario"},
    "paper": {"core", "models", "trace", "hinf"},
    "vehicle": {
        "core",
        "models",
        "network",
        "trace",
        "hinf",
        "fmu",
        "master",
        "recordings",
        "scenario",
    },
}
LOWER["cli"] = {*LOWER}
"""Package -> the packages that it may import from."""
LOWER_ROOMS: dict[str, set[str]] = {
    "exact": set(),
    "theorems": {"exact"},
    "certificate": {"exact", "theorems"},
    "problem": {"exact", "certificate"},
    "delay_lti": {"exact", "certificate"},
    "lmi": {"exact", "theorems", "certificate", "problem"},
    "synthesis": {"exact", "theorems", "certificate", "problem", "delay_lti", "lmi"},
}
"""Room of `cosim.hinf` -> the rooms that it may import from."""

ROOMS_WITH_FACES = {
    "hinf": tuple(LOWER_ROOMS),
    "trace": (
        *("outcome", "rows", "tables", "comparison", "exports", "report", "live", "ros2"),
        "viewers",
    ),
    "fmu": ("compiled", "export", "inspect"),
}
"""Package -> its rooms that have a face of their own, for other packages and tests."""

THROUGH_FACES = (
    *("cli", "components", "fmu", "hinf", "models", "network", "paper", "recordings", "replay"),
    *("scenario", "study", "trace", "vehicle"),
)
"""Packages whose tests, wherever they are, know their faces alone."""

ROOMS_OF_TRACE = (
    *("file", "rows", "outcome", "tables", "digest", "former_digest", "writer", "info_view"),
    *("recorded_rows", "rows_in_memory", "reader"),
    *("recovered", "checks", "content", "picture", "traces", "ros2", "viewers"),
    *("info", "citation", "recovery", "comparison", "exports", "report", "live"),
)
"""Rooms and modules of `cosim.trace`; each may import from those before it."""


def files() -> list[tuple[str, Path]]:
    """Package ("components" for what lies in fmu_src) and path of every product module."""
    found = [(path.relative_to(ROOT).parts[1], path) for path in ROOT.glob("cosim/*/**/*.py")]
    found += [("components", path) for path in ROOT.glob("fmu_src/**/*.py")]
    assert len(found) > 300
    return found


@cache
def imported(path: Path) -> list[tuple[int, str]]:
    """Line and full name of everything of ours that a module imports, wherever it does."""
    found: list[tuple[int, str]] = []
    text = path.read_text("utf-8")
    if "cosim" not in text and "fmu_src" not in text:
        return found
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found += [(node.lineno, f"{node.module}.{alias.name}") for alias in node.names]
        elif isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
    return [item for item in found if item[1].split(".")[0] in ("cosim", "fmu_src")]


def packages() -> list[str]:
    """Every package and room with a face, the front door first."""
    rooms = (f"cosim.{name}.{room}" for name, all_ in ROOMS_WITH_FACES.items() for room in all_)
    return ["cosim", *(f"cosim.{name}" for name in LOWER), *rooms]


def between_rooms() -> list[tuple[str, str, str]]:
    """Room, place and full name of what a room of `cosim.hinf` imports from beyond itself."""
    return [
        (room, f"{path.relative_to(ROOT)}:{line}", name)
        for room in LOWER_ROOMS
        for path in ROOT.glob(f"cosim/hinf/{room}/**/*.py")
        for line, name in imported(path)
        if name.startswith("cosim.hinf.") and name.split(".")[2] != room
    ]


def test_every_package_is_known_here() -> None:
    """A new package is given its place among the others."""
    assert {m.name for m in pkgutil.iter_modules(cosim.__path__) if m.ispkg} == set(LOWER)


def test_nothing_is_imported_past_a_face() -> None:
    """Across packages: `from cosim.network import ...`, never from a module inside.

    The rooms of `cosim.hinf` have faces too: `from cosim.hinf.delay_lti import ...`.
    """
    past = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for package, path in files()
        for line, name in imported(path)
        if name.split(".")[1] != package and is_past_a_face(name)
    ]
    assert past == []


@pytest.mark.parametrize("package", THROUGH_FACES)
def test_tests_go_through_faces(package: str) -> None:
    """So that the inside of these packages may change: nothing of it is imported by a test."""
    past = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in ROOT.glob("tests/**/*.py")
        for line, name in imported(path)
        if name.split(".")[1:2] == [package] and is_past_a_face(name)
    ]
    assert past == []


def is_past_a_face(name: str) -> bool:
    """Whether a full name is of a module inside a package, or of what such a module holds."""
    faces = [
        *packages(),
        "cosim.hinf.certificate.standalone",
    ]  # it shares nothing, not even the stub
    return name.rpartition(".")[0] not in faces and name not in faces


@pytest.mark.parametrize("package", ROOMS_WITH_FACES)
def test_the_first_face_of_a_package_with_rooms_is_short(package: str) -> None:
    """What most users need; all else is in the faces of its rooms."""
    face = importlib.import_module(f"cosim.{package}")
    offered = {name for name in face.__all__ if not isinstance(getattr(face, name), ModuleType)}
    assert len(offered) <= 30
    assert set(face.__all__) - offered <= set(ROOMS_WITH_FACES[package])


@pytest.mark.parametrize("package", ["trace", "fmu"])
def test_no_two_classes_of_a_package_have_one_name(package: str) -> None:
    """Whoever reads a name in a message or in a module knows which class it is."""
    found: dict[str, list[str]] = {}
    for path in ROOT.glob(f"cosim/{package}/**/*.py"):
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found.setdefault(node.name, []).append(path.name)
    assert len(found) > 50
    assert {name: where for name, where in found.items() if len(where) > 1} == {}


def test_imports_point_one_way() -> None:
    """No package imports from one above it, and nothing imports the command line."""
    allowed = {**LOWER, "components": {"core", "models", "fmu", "network"}}
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for package, path in files()
        for line, name in imported(path)
        if name.split(".")[1] != package and name.split(".")[1] not in allowed[package]
    ]
    assert wrong == []


def test_every_room_of_hinf_is_known_here() -> None:
    """A new room is given its place among the others, and no module lies outside them."""
    modules = pkgutil.iter_modules([str(ROOT / "cosim" / "hinf")])
    assert {module.name for module in modules} == set(LOWER_ROOMS)


def test_imports_between_the_rooms_point_one_way() -> None:
    """Only from the face of a lower room; imports for types and inside functions count too."""
    found = between_rooms()
    assert len(found) > 100
    wrong = [
        f"{place}: {name}"
        for room, place, name in found
        if name.split(".")[2] not in LOWER_ROOMS[room] or len(name.split(".")) > 4
    ]
    assert wrong == []


def test_imports_between_the_rooms_of_traces_point_one_way() -> None:
    """From what a file is, through rows and tables, to what is done with a trace."""
    modules = pkgutil.iter_modules([str(ROOT / "cosim" / "trace")])
    assert {module.name for module in modules} == set(ROOMS_OF_TRACE)
    places = [
        (path.relative_to(ROOT / "cosim" / "trace").parts[0].removesuffix(".py"), path)
        for path in ROOT.glob("cosim/trace/**/*.py")
    ]
    found = [
        (room, name.split(".")[2], f"{path.relative_to(ROOT)}:{line}: {name}")
        for room, path in places
        for line, name in imported(path)
        if name.startswith("cosim.trace.") and name.split(".")[2] in ROOMS_OF_TRACE
    ]
    assert len(found) > 200
    order = ROOMS_OF_TRACE.index
    assert [place for room, other, place in found if order(other) > order(room)] == []


def test_the_prover_needs_no_solver() -> None:
    """With cvxpy and Clarabel blocked, every module of it is imported, and no other room is."""
    script = """
import importlib, json, pkgutil, sys
sys.modules["cvxpy"] = sys.modules["clarabel"] = None
import cosim.hinf.certificate as face
for module in pkgutil.iter_modules(face.__path__, face.__name__ + "."):
    importlib.import_module(module.name)
for name in face.__all__:
    getattr(face, name)
print(json.dumps(sorted(sys.modules)))
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    loaded = set(json.loads(done.stdout))
    assert "cosim.hinf.theorems.proof" in loaded
    rooms = {name.split(".")[2] for name in loaded if name.startswith("cosim.hinf.")}
    assert rooms == {"certificate", "exact", "theorems"}


def test_the_components_are_no_package_of_their_own() -> None:
    """They are loaded by folder: no module, test or script imports `fmu_src`."""
    scripts = [*ROOT.glob("tests/**/*.py"), ROOT / "build_fmu.py", *(path for _, path in files())]
    named = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in scripts
        for line, name in imported(path)
        if name.split(".")[0] == "fmu_src"
    ]
    assert named == []
    assert not (ROOT / "fmu_src" / "__init__.py").exists()


def test_the_front_door_offers_what_it_promises() -> None:
    """These names, and `dir` and `__all__` say so."""
    assert set(cosim.__all__) == FRONT_DOOR
    assert set(dir(cosim)) >= FRONT_DOOR


def test_the_front_door_opens_at_once() -> None:
    """`import cosim` alone loads no numeric library, no validator, no other module of ours."""
    script = "import cosim, json, sys; print(json.dumps(sorted(sys.modules)))"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)  # noqa: S603
    loaded = set(json.loads(done.stdout))
    assert loaded.isdisjoint({"numpy", "scipy", "pydantic", "typer", "fmpy", "cvxpy", "mcap"})
    assert {name for name in loaded if name.startswith("cosim.")} == set()


@pytest.fixture(scope="module")
def after_all_imports() -> dict[str, list[str]]:
    """By package, the names of its face that are modules once every module was imported."""
    script = f"""
import importlib, json, pkgutil, sys, types
import cosim
for module in pkgutil.walk_packages(cosim.__path__, "cosim."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
faces = {{name: importlib.import_module(name) for name in {packages()!r}}}
print(json.dumps({{
    name: [n for n in face.__all__ if isinstance(getattr(face, n), types.ModuleType)]
    for name, face in faces.items()
}}))
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    found: dict[str, list[str]] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("package", packages())
def test_each_name_is_what_it_says_after_every_module_was_imported(
    package: str, after_all_imports: dict[str, list[str]]
) -> None:
    """No module hides a function of its name; a module is offered only where the face says so."""
    face = importlib.import_module(package)
    stub = Path(str(face.__file__)).with_suffix(".pyi")
    offered = {
        alias.name: node.module
        for node in ast.parse(stub.read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(offered) == set(face.__all__)
    as_modules = {name for name, module in offered.items() if module is None}
    assert set(after_all_imports[package]) == as_modules
    modules = {module.name for module in pkgutil.iter_modules(face.__path__)}
    assert {name for name in offered if name in modules} == as_modules
