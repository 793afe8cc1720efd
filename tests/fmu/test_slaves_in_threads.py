"""What threads of a process share when they load and call FMUs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import TypeVar

import fmpy
import pytest
from compiled import HEADERS
from foreign.c_fmu import c_fmu, every, source_of, talker
from packed import files_of, pack

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuSlave, describe_fmu

THREADS = 8
T = TypeVar("T")


def silent(_level: str, _message: str, _category: str) -> None:
    """Ignore messages."""


def in_threads(work: Callable[[int], T]) -> list[T]:
    """What a function returns in each of several threads that begin at the same time."""
    begin = Barrier(THREADS)

    def at_once(number: int) -> T:
        begin.wait(60)
        return work(number)

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(at_once, range(THREADS)))


@pytest.mark.parametrize("which", ["talker_fmi2.c", "every_fmi3.c"])
def test_no_folder_is_changed_to_load_an_fmu(
    which: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The working directory is that of all threads: FMPy would change it, and is kept from it."""
    described = describe_fmu(c_fmu(which, talker() if "2" in which else every(), tmp_path))
    monkeypatch.setattr(os, "chdir", lambda _: pytest.fail("the folder is changed"))
    with FmuSlave(described, "it", silent) as slave:
        slave.initialise({}, 0.0, 1.0)
        slave.step(0.0, 0.5)


@pytest.mark.skipif(sys.platform != "linux", reason="says where libraries are as ELF does")
def test_library_that_looks_in_the_working_directory_finds_its_neighbour(tmp_path: Path) -> None:
    """As with importers that change the folder to load it; one that is nowhere is named."""
    cc = shutil.which("cc")
    if cc is None:
        pytest.skip("needs a C compiler (cc)")
    beside, main, fmu = (tmp_path / name for name in ("libbeside.so", "talker.so", "x.fmu"))
    (tmp_path / "beside.c").write_text("int beside(void) { return 0; }\n")
    text = source_of("talker_fmi2.c") + (
        "\nint beside(void);\n__attribute__((constructor)) static void begin(void) { beside(); }\n"
    )
    (tmp_path / "talker.c").write_text(text)
    shared = [cc, "-shared", "-fPIC", f"-I{HEADERS}"]
    for line in (
        [*shared, "beside.c", "-Wl,-soname,libbeside.so", "-o", beside],
        [*shared, "talker.c", beside, "-Wl,-rpath,.", "-o", main],
    ):
        subprocess.run(line, cwd=tmp_path, check=True)  # noqa: S603 - our own source
    files = files_of(c_fmu("talker_fmi2.c", talker(), tmp_path))
    folder = f"binaries/{fmpy.platform}"
    files[f"{folder}/talker_fmi2.so"] = main.read_bytes()
    lonely = describe_fmu(pack(files, tmp_path / "lonely.fmu"))
    with pytest.raises(ComponentError, match=r"libbeside\.so: cannot open shared object file"):
        FmuSlave(lonely, "it", silent)
    files[f"{folder}/libbeside.so"] = beside.read_bytes()
    with FmuSlave(describe_fmu(pack(files, fmu)), "it", silent) as slave:
        slave.initialise({}, 0.0, 1.0)


def test_one_thread_has_the_fmu_that_a_process_may_have_once(tmp_path: Path) -> None:
    """Of all that begin at the same time one has it; the others are refused by name."""
    flags = 'canBeInstantiatedOnlyOncePerProcess="true"'
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(flags=flags), tmp_path))
    tried = Barrier(THREADS)

    def attempt(number: int) -> str:
        try:
            slave = FmuSlave(described, f"number {number}", silent)
        except InputError as error:
            tried.wait(60)
            return str(error)
        tried.wait(60)
        slave.close()
        return "made"

    found = in_threads(attempt)
    assert found.count("made") == 1
    owner = found.index("made")
    others = [text for text in found if text != "made"]
    assert all("only once in a process" in text for text in others)
    assert all(f"component 'number {owner}' is an instance of it" in text for text in others)


@pytest.mark.parametrize("environment", ["passed on", "not passed on"])
def test_messages_of_threads_go_to_their_components(environment: str, tmp_path: Path) -> None:
    """Components of one name, also of an FMU that does not say for which one its message is."""
    text = source_of("talker_fmi2.c")
    if environment == "not passed on":
        text = text.replace("(m)->calls->componentEnvironment", "NULL")
    folder = tmp_path / "own"
    folder.mkdir()
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(), folder, text=text))

    def run(_number: int) -> int:
        heard: list[str] = []
        with FmuSlave(described, "it", lambda _level, text, _category: heard.append(text)) as slave:
            slave.initialise({}, 0.0, 1.0)
            slave.step(0.0, 0.5)
        return heard.count("terminated")

    for _ in range(5):
        assert in_threads(run) == [1] * THREADS
