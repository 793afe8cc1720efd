"""Which FMUs can be instantiated here, and the messages about those that cannot."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from foreign.c_fmu import c_fmu, every, talker
from packed import Files, files_of, pack, renamed, with_file, without

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuSlave, describe_fmu


def silent(_level: str, _message: str, _category: str) -> None:
    """Ignore messages."""


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good FMU 2.0 for this machine."""
    return c_fmu("talker_fmi2.c", talker(), tmp_path_factory.mktemp("talker"))


def _renamed_library(files: Files) -> None:
    library = f"binaries/{fmpy.platform}/talker_fmi2{fmpy.sharedLibraryExtension}"
    renamed(library, f"binaries/{fmpy.platform}/talk{fmpy.sharedLibraryExtension}")(files)


def _no_library(files: Files) -> None:
    without("binaries/")(files)
    with_file("sources/all.c", b"int x;")(files)


def _no_code(files: Files) -> None:
    library = f"binaries/{fmpy.platform}/talker_fmi2{fmpy.sharedLibraryExtension}"
    with_file(library, b"no library")(files)


@pytest.mark.parametrize(
    ("damage", "got", "hint"),
    [
        (renamed(f"binaries/{fmpy.platform}/", "binaries/vax/"), "only for vax", None),
        (_no_library, "nor for any other platform", "fmpy compile"),
        (_renamed_library, "but the model identifier is talker_fmi2", None),
        (_no_code, "talker_fmi2", None),
    ],
)
def test_library_that_does_not_load_is_reported(
    intact: Path, tmp_path: Path, damage: Callable[[Files], None], got: str, hint: str | None
) -> None:
    """None for this machine, one of another name, none at all, a file that is not a library."""
    files = files_of(intact)
    damage(files)
    before = Path.cwd()
    with pytest.raises(ComponentError, match="the FMU cannot be loaded") as caught:
        FmuSlave(describe_fmu(pack(files, tmp_path / "x.fmu")), "sea", silent)
    assert Path.cwd() == before
    assert "component 'sea'" in str(caught.value)
    assert got in str(caught.value.got)
    assert (hint is None) == (caught.value.hint is None)
    assert hint is None or hint in str(caught.value.hint)


def test_damaged_content_is_reported(intact: Path, tmp_path: Path) -> None:
    """An archive whose description can be read, but not the rest."""
    content = bytearray(intact.read_bytes())
    place = content.rindex(b"everything is lost")
    content[place] ^= 0xFF
    path = tmp_path / "damaged.fmu"
    path.write_bytes(content)
    with pytest.raises(InputError, match="the FMU cannot be unpacked"):
        FmuSlave(describe_fmu(path), "it", silent)


def test_fmu_that_changed_since_it_was_read_is_reported(intact: Path, tmp_path: Path) -> None:
    """Also one that was removed since."""
    path = tmp_path / "x.fmu"
    files = files_of(intact)
    described = describe_fmu(pack({**files, "one": b"1"}, path))
    pack({**files, "two": b"2"}, path)
    with pytest.raises(InputError, match="the FMU has changed since it was read"):
        FmuSlave(described, "it", silent)
    path.unlink()
    with pytest.raises(InputError, match="the FMU cannot be read any more"):
        FmuSlave(described, "it", silent)


def test_refusal_to_be_instantiated_names_the_tool(intact: Path, tmp_path: Path) -> None:
    """An FMU that needs another program, which is not installed."""
    source = (
        "#include <stddef.h>\n"
        'const char *fmi2GetVersion(void) { return "2.0"; }\n'
        "void *fmi2Instantiate(void) { return NULL; }\n"
        "void fmi2FreeInstance(void *c) { (void)c; }\n"
    )
    del intact
    folder = tmp_path / "tool"
    folder.mkdir()
    path = c_fmu("talker_fmi2.c", talker(flags='needsExecutionTool="true"'), folder, text=source)
    described = describe_fmu(path)
    assert described.needs_execution_tool
    with pytest.raises(ComponentError, match="the FMU refuses to be instantiated") as caught:
        FmuSlave(described, "it", silent)
    assert caught.value.hint == "it needs a program to run in, made by: A tool"


def test_library_without_the_functions_is_reported(tmp_path: Path) -> None:
    """One that lacks even those that every slave needs."""
    path = c_fmu("every_fmi3.c", every(), tmp_path, text="int nothing;\n")
    with pytest.raises(ComponentError, match="lacks a function") as caught:
        FmuSlave(describe_fmu(path), "it", silent)
    assert "fmi3InstantiateCoSimulation" in str(caught.value.got)


def test_second_instance_is_refused_where_one_is_allowed(tmp_path: Path) -> None:
    """After the first one is closed, another is allowed."""
    flags = 'canBeInstantiatedOnlyOncePerProcess="true"'
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(flags=flags), tmp_path))
    for _ in range(2):
        with FmuSlave(described, "first", silent) as first:
            first.initialise({}, 0.0, 1.0)
            with pytest.raises(InputError, match="only once in a process") as caught:
                FmuSlave(described, "second", silent)
            assert "component 'first' is an instance of it" in str(caught.value)
            first.step(0.0, 0.5)


# In a process of its own: what the tests before leave behind is freed and asked for at any time.
LIVES = """
import sys
from pathlib import Path
import psutil
from cosim.core import CosimError
from cosim.fmu import FmuSlave, describe_fmu

described, process = describe_fmu(Path(sys.argv[1])), psutil.Process()

def live():
    with FmuSlave(described, "it", lambda *_: None) as slave:
        slave.initialise({}, 0.0, 1.0)
        slave.step(0.0, 0.5)
        slave.read([p.name for p in described.ports.values() if p.kind not in (None, "clock")])
        try:
            slave.write({"nothing": 1.0})
        except CosimError:
            return
    raise SystemExit("an unknown variable was written")

for _ in range(50):
    live()
before, files = process.memory_info().rss, process.num_fds()
for _ in range(400):
    live()
print(process.memory_info().rss - before, process.num_fds() - files)
print(*(m.path for m in process.memory_maps() if described.sha256 in m.path))
"""


@pytest.mark.parametrize("which", ["talker", "every"])
def test_hundreds_of_instances_leave_nothing(tmp_path: Path, which: str) -> None:
    """No memory, open file or library is left after run and free, nor after a refusal."""
    source, text = {
        "talker": ("talker_fmi2.c", talker()),
        "every": ("every_fmi3.c", every()),
    }[which]
    done = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, "-c", LIVES, c_fmu(source, text, tmp_path)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    left, loaded = done.stdout.splitlines()
    memory, files = map(int, left.split())
    assert memory < 2 << 20
    assert files <= 0
    assert loaded == ""
