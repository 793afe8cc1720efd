"""What goes on without something: extras, a cache that can be written, a folder for FMUs."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from shared import fmu_store
from wheel import installed, python

from cosim.core import InputError, notices
from cosim.fmu import own_folder
from cosim.fmu.export import ensure_fmu
from cosim.scenario import FmuCache, demo, fmu_cache


def test_the_demo_flies_without_matplotlib(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Both runs are there, no picture, and the extra that draws it is named."""

    def missing() -> None:
        raise InputError("pictures need matplotlib", hint="pip install 'auv-cosim[plot]'")

    def finished(*_: Any, **__: Any) -> Any:
        return SimpleNamespace(metrics={"designed_age_s": 1.0})

    prepared = SimpleNamespace(problem=None)

    monkeypatch.setattr(demo, "pyplot", missing)
    monkeypatch.setattr(demo, "prepare", lambda *_, **__: prepared)
    monkeypatch.setattr(demo, "execute_run", finished)
    found = demo.demonstrate(FmuCache(tmp_path, tmp_path), tmp_path)
    assert list(found.outcomes) == ["delay-aware", "naive"]
    assert found.picture is None
    assert "auv-cosim[plot]" in str(found.no_picture)


NO_READERS = """
import json, sys
for name in ("elftools", "pefile", "macholib"):
    sys.modules[name] = None
from pathlib import Path
from cosim.fmu.inspect import inspect_fmu
found = inspect_fmu(Path(sys.argv[1]))
print(json.dumps([found.valid, [(f.code, f.level, f.why) for f in found.findings]]))
"""


def test_an_fmu_is_checked_without_readers_of_binaries() -> None:
    """What needs them is not checked, which is said once and is no error."""
    done = python(NO_READERS, str(fmu_store("native") / "native" / "WaveField.fmu"))
    assert done.returncode == 0, done.stderr.decode()
    valid, findings = json.loads(done.stdout)
    notes = [(level, why) for code, level, why in findings if code == "binary-unexamined"]
    assert valid
    assert [(level, "auv-cosim[check]" in why) for level, why in notes] == [("note", True)]
    assert {code for code, *_ in findings}.isdisjoint({"binary-damaged", "binary-unread"})


NO_ROSBAGS = """
import sys
sys.modules["rosbags"] = sys.modules["rosbags.typesys"] = None
from pathlib import Path
from cosim.core import InputError
from cosim.trace import TraceWriter
from cosim.trace.ros2 import export_bag
path = Path(sys.argv[1])
with TraceWriter(path, run={}) as writer:
    writer.log(0, "info", "a", "b")
    writer.finish({})
try:
    export_bag(path, None)
except InputError as error:
    print(error)
"""


def test_a_bag_needs_an_extra_and_says_so(tmp_path: Path) -> None:
    """No file is left over."""
    done = python(NO_ROSBAGS, str(tmp_path / "a.mcap"))
    assert done.returncode == 0, done.stderr.decode()
    assert "pip install 'auv-cosim[ros2]'" in done.stdout.decode()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_an_fmu_is_checked_with_a_handful_of_packages(tmp_path: Path) -> None:
    """Those of docs/how-to/own-fmus.md, and the two that typer brings."""
    allowed = {"cosim", "lazy_loader", "lxml", "pydantic", "rich", "typer"}
    code = (
        "import sys\n"
        "class Blocked:\n"
        "    def find_spec(self, name, *_):\n"
        "        top = name.partition('.')[0]\n"
        f"        if top in {sorted(_distributed() - allowed)!r}:\n"
        "            raise ModuleNotFoundError(name, name=name)\n"
        "sys.meta_path.insert(0, Blocked())\n"
        "from cosim.cli.entry import main\n"
        "main()\n"
    )
    fmu = fmu_store("native") / "native" / "WaveField.fmu"
    done = subprocess.run(  # noqa: S603 - this interpreter
        [sys.executable, "-c", code, "fmu", "check", str(fmu), "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["valid"]


def _distributed() -> set[str]:
    """The modules that this project's dependencies bring, but for FMPy: its schemas are files."""
    root = Path(__file__).parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    names = {re.split(r"[^\w-]", each)[0].lower() for each in project["dependencies"]}
    modules = packages_distributions()
    found = {top for top, of in modules.items() if names & {each.lower() for each in of}}
    assert {"numpy", "scipy", "cvxpy", "pydantic"} <= found
    return found - {"fmpy"}


TWO_LIBRARIES = """
from pathlib import Path
from cosim.fmu import own_folder
from cosim.fmu.compiled import compiled_library
source = b'__attribute__((visibility("default"))) int seven(void) { return 7; }\\n'
for extra in (b"", b"int eight(void) { return 8; }\\n"):
    library = compiled_library("seven", source + extra)
    print(library.seven(), Path(library._name).parent == own_folder())
"""


def test_a_library_is_compiled_where_the_cache_cannot_be_written(tmp_path: Path) -> None:
    """It lies in the temporary folder of the process; standard error says so once."""
    blocked = tmp_path / "no folder"
    blocked.write_text("a file")
    done = python(TWO_LIBRARIES, XDG_CACHE_HOME=str(blocked))
    printed = done.stderr.decode()
    assert done.stdout.split() == [b"7", b"True"] * 2, printed
    assert printed.count("cannot be written") == 1
    assert str(blocked) in printed
    assert "XDG_CACHE_HOME" in printed


def test_fmus_are_built_where_their_folder_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """They lie in the temporary folder of the process; standard error says so once."""
    blocked = tmp_path / "fmus"

    def ensured(fmu: str, folder: Path, **more: Any) -> Any:
        if folder == blocked:  # the tests may be allowed to write everywhere
            raise PermissionError(errno.EACCES, "Permission denied")
        return ensure_fmu(fmu, folder, **more)

    monkeypatch.setattr(fmu_cache, "ensure_fmu", ensured)
    notices.say_once.cache_clear()
    cache = FmuCache(blocked, tmp_path, flavour="python")
    found = [cache.find("WaveField").path for _ in range(2)]
    assert found[0] == found[1]
    assert found[0].is_relative_to(own_folder())
    printed = capfd.readouterr().err
    assert printed.count("cannot be written") == 1
    assert "--fmus" in printed


@pytest.mark.slow
def test_a_command_goes_on_without_home_and_cache(tmp_path: Path) -> None:
    """What needs a cache: a run, with a kernel and FMUs."""
    blocked = tmp_path / "no folder"
    blocked.write_text("a file")
    done = subprocess.run(
        [sys.executable, "-m", "cosim", "run", "paper-example"],
        cwd=tmp_path,
        env=os.environ | {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "unexpected" not in done.stdout + done.stderr
    assert "cosim:" not in done.stdout, "said to the user, not in the trace"


UP_TO_DATE = """
import sys
from pathlib import Path
from cosim.fmu.export import ensure_fmu
print(*(ensure_fmu(name, Path(sys.argv[1]), flavour="python").new for name in sys.argv[2:]))
print("markdown_it" in sys.modules)
"""


def test_a_guid_is_computed_once_for_the_same_sources(tmp_path: Path) -> None:
    """It is computed again for other sources, for a damaged file, and where none can be kept."""
    package = installed(tmp_path / "site", {})
    models = package / "cosim" / "models"
    source = models.readlink()
    models.unlink()
    shutil.copytree(source, models)
    cache, fmus = tmp_path / "cache", fmu_store("python")

    def computed(*names: str, cache: Path = cache) -> bool:
        """Whether a GUID is computed to find that FMUs are up to date: it has a page's text."""
        environment = {"XDG_CACHE_HOME": str(cache)}
        done = python(UP_TO_DATE, str(fmus), *names, packages=[package], **environment)
        *new, page = done.stdout.decode().split()
        assert new == ["False"] * len(names), done.stderr.decode()
        return page == "True"

    a, b = "WaveField", "PaperController"
    assert [computed(*names) for names in ([a], [a], [b], [b], [a, b])] == [
        *(True, False, True, False, False)
    ]
    (file,) = cache.rglob("guids-*")
    file.write_text("[]")
    assert [computed(a), computed(a)] == [True, False]
    with (models / "auv.py").open("a") as changed:  # in neither of the two
        changed.write("\n")
    assert [computed(a), computed(a)] == [True, False]
    assert [computed(a, cache=file), computed(a, cache=file)] == [True, True]


def test_an_installation_without_extras_names_them() -> None:
    """Every extra that an error names exists."""
    root = Path(__file__).parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    named: set[str] = set()
    for path in (root / "cosim").rglob("*.py"):
        for pair in re.findall(r'\bextra="(\w+)"|auv-cosim\[(\w+)\]', path.read_text("utf-8")):
            named |= {*filter(None, pair)} - {"allow", "forbid"}  # pydantic's own
    assert len(named) > 4
    assert named <= set(project["optional-dependencies"])
