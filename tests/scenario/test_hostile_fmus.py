"""FMUs with paths outside their folder: run, session and study refuse them without side effects."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from cli.shell import cosim
from fmu.packed import XML, files_of, pack
from hostile.hostile_fmu import hostile_fmu

from cosim.core.errors import InputError
from cosim.scenario.python_api import open_session
from cosim.study import run_study

SCENARIO = """
title = "A guest"
[run]
end = 0.2
step = 0.1
[components.guest]
fmu = "guest.fmu"
parameters = { u = 1.0 }
"""
STUDY = """
title = "A guest"
scenario = "s.toml"
[[vary]]
kind = "grid"
name = "u"
path = "components.guest.parameters.u"
values = [1.0, 2.0]
[metrics]
x = "final.guest.x"
"""
EVIL = """
#include <stdio.h>
__attribute__((constructor)) static void loaded(void) { fclose(fopen("MARK", "w")); }
"""
Change = Callable[[Path, Path], None]
"""Changes the FMU; the folder is for what it is to do there."""


def with_entries(*names: str, zeros: int = 0, mode: int = 0o100644) -> Change:
    def change(fmu: Path, folder: Path) -> None:
        with zipfile.ZipFile(fmu, "a") as archive:
            for name in names:
                entry = zipfile.ZipInfo(name.format(folder=folder))
                entry.external_attr, entry.compress_type = mode << 16, zipfile.ZIP_DEFLATED
                with archive.open(entry, "w") as stream:
                    for _ in range(zeros >> 20):
                        stream.write(bytes(1 << 20))

    return change


def called(identifier: str) -> Change:
    """A model identifier that leads to a library which leaves a mark when it is loaded."""

    def change(fmu: Path, folder: Path) -> None:
        source, library = folder / "evil.c", folder / f"evil{fmpy.sharedLibraryExtension}"
        source.write_text(EVIL.replace("MARK", str(folder / "mark")))
        line = ["cc", "-shared", "-fPIC", str(source), "-o", str(library)]
        subprocess.run(line, check=True)  # noqa: S603 - our own source
        files = files_of(fmu)
        name = identifier.format(folder=folder).encode()
        files[XML] = files[XML].replace(b'modelIdentifier="guest"', b'modelIdentifier="%b"' % name)
        pack(files | {f"x/{library.name}": library.read_bytes()}, fmu)

    return change


HOSTILE: dict[str, tuple[Change, str, str]] = {
    "identifier": (called("../../x/evil"), "modelDescription.xml", "'../../x/evil'"),
    "identifier-absolute": (called("{folder}/evil"), "modelDescription.xml", "/evil'"),
    "parent": (with_entries("resources/../../../mark"), "resources/../../../mark", "leaves"),
    "absolute": (with_entries("{folder}/mark"), "/mark", "leaves the folder"),
    "link": (with_entries("link", mode=0o120777), "link", "symbolic link"),
    "bomb": (
        with_entries("resources/zeros", zeros=600 << 20),
        "resources/zeros",
        f"bytes unpack to {600 << 20}; at most 250 times as many",
    ),
    "bomb-of-many": (
        with_entries(*(f"resources/{i}" for i in range(12)), zeros=50 << 20),
        "guest.fmu",
        "at most 250 times as many",
    ),
}
"""What is done, the entry that is named, and what is said of it, the limit included."""


@pytest.mark.parametrize("kind", HOSTILE)
def test_fmu_with_paths_outside_is_refused_by_all_that_run_it(tmp_path: Path, kind: str) -> None:
    """Bad input: the file, the entry, the limit; what was to be written or loaded is not there."""
    change, entry, message = HOSTILE[kind]
    home = tmp_path / "home"
    home.mkdir()
    fmu = hostile_fmu(home, "2.0", "guest")
    (home / "s.toml").write_text(SCENARIO)
    (home / "study.toml").write_text(STUDY)
    sound = cosim("run", "s.toml", "--json", cwd=home)
    assert sound.code == 0, sound.err
    change(fmu, tmp_path)
    run = cosim("run", "s.toml", "--json", cwd=home)
    assert run.code == 2
    error = run.error
    assert f"{fmu}: " in error["where"]
    assert entry in error["where"].rpartition("fmu: ")[2] or entry == fmu.name
    assert message in error["got"]
    assert error["hint"]
    with pytest.raises(InputError) as session, open_session(home / "s.toml"):
        pass
    with pytest.raises(InputError) as study:
        run_study(str(home / "study.toml"), home / "out")
    for refused in (session.value, study.value):
        assert (refused.what, refused.got) == (error["what"], error["got"])
    check = cosim("fmu", "check", fmu, "--run", "--json", cwd=home)
    assert error["got"] in [finding["what"] for finding in check.json["findings"]]
    assert not (tmp_path / "mark").exists()
