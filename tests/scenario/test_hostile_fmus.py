"""Hostile archives: run, session, study and import refuse them before anything is unpacked."""

from __future__ import annotations

import copy
import subprocess
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from cli.shell import cosim
from fmu.packed import XML, files_of, pack
from hostile.hostile_fmu import hostile_fmu
from shared import sampled
from ssp.archives import component, ssd

from cosim.core import InputError
from cosim.scenario import open_session
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
        with warnings.catch_warnings(), zipfile.ZipFile(fmu, "a") as archive:
            warnings.simplefilter("ignore")  # of names that are there twice
            for name in names:
                entry = zipfile.ZipInfo(name.format(folder=folder))
                entry.external_attr, entry.compress_type = mode << 16, zipfile.ZIP_DEFLATED
                with archive.open(entry, "w") as stream:
                    for _ in range(zeros >> 20):
                        stream.write(bytes(1 << 20))

    return change


def with_other_content(name: str) -> Change:
    def change(fmu: Path, _folder: Path) -> None:
        with warnings.catch_warnings(), zipfile.ZipFile(fmu, "a") as archive:
            warnings.simplefilter("ignore")
            archive.writestr(name, b"one")
            archive.writestr(name, b"another")

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


def encrypted(fmu: Path, _folder: Path) -> None:
    """One entry says that it is."""
    with_entries("resources/secret")(fmu, fmu)
    content = bytearray(fmu.read_bytes())
    content[content.rindex(b"PK\x01\x02") + 8] |= 1
    fmu.write_bytes(content)


def overlapping(fmu: Path, _folder: Path) -> None:
    """A hundred entries lie on the same bytes; each alone is packed as text may be."""
    draws = np.random.default_rng(1)
    content = b"".join(draws.bytes(80) + bytes(8112) for _ in range(128))
    with zipfile.ZipFile(fmu, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/00", content)
        one = archive.getinfo("resources/00")
        assert one.file_size < 200 * one.compress_size
        for i in range(1, 100):
            another = copy.copy(one)
            another.filename = f"resources/{i:02}"
            archive.filelist.append(another)


def described(old: str, new: str) -> Change:
    """Another text in the model description, which is stored as it is."""

    def change(fmu: Path, folder: Path) -> None:
        (folder / "secret").write_text("secret")
        files = files_of(fmu)
        before = files[XML]
        files[XML] = before.replace(old.encode(), new.replace("{folder}", str(folder)).encode(), 1)
        assert files[XML] != before
        with zipfile.ZipFile(fmu, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)

    return change


ROOT = "<fmiModelDescription "
LAUGHS = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
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
    "backslash": (with_entries("resources\\mark"), "resources\\mark", "has a backslash"),
    "twice": (with_other_content("resources/a"), "resources/a", "there twice"),
    "case": (with_entries("resources/a", "resources/A"), "resources/A", "differs from resources/a"),
    "composed": (
        with_entries("resources/\u00e9", "resources/e\u0301"),
        "resources/e\u0301",
        "differs from resources/\u00e9",
    ),
    "encrypted": (encrypted, "resources/secret", "encrypted"),
    "many": (with_entries(*(f"{i}" for i in range(100_001))), "guest.fmu", "at most 100000 of"),
    "overlapping": (overlapping, "guest.fmu", "at most 250 times as many"),
    "entities": (
        described(ROOT, f'<!DOCTYPE x [<!ENTITY e0 "ha">{LAUGHS}]>{ROOT}description="&e9;" '),
        XML,
        "",
    ),
    "external": (
        described(ROOT, f'<!DOCTYPE x [<!ENTITY e SYSTEM "file://{{folder}}/secret">]>{ROOT}'),
        XML,
        "document type",
    ),
    "deep": (
        described("<LogCategories>", "<a>" * 100_000 + "</a>" * 100_000 + "<LogCategories>"),
        XML,
        "depth",
    ),
    "attribute": (described(ROOT, f'{ROOT}description="{"a" * (11 << 20)}" '), XML, ""),
    "large": (
        described(ROOT, f"<!--{'abcdefg ' * (13 << 20)}-->{ROOT}"),
        XML,
        f"more than {64 << 20} bytes",
    ),
}
"""What is done, the entry that is named, and what is said of it, the limit included; an empty text
for the words of the XML parser, which differ between versions."""


@pytest.mark.parametrize("kind", sampled(HOSTILE, 3))
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
    element = component("guest", "resources/guest.fmu")
    system = ssd(f"<ssd:Elements>{element}</ssd:Elements>").encode()
    pack({"SystemStructure.ssd": system, "resources/guest.fmu": fmu.read_bytes()}, home / "s.ssp")
    (home / "imported").mkdir()
    imported = cosim("ssp", "import", "s.ssp", "-o", "imported/s.toml", "--json", cwd=home)
    assert imported.code == 2
    assert (imported.error["what"], imported.error["got"]) == (error["what"], error["got"])
    assert "s.ssp: resources/guest.fmu: " in imported.error["where"]
    assert list((home / "imported").iterdir()) == []
    check = cosim("fmu", "check", fmu, "--run", "--json", cwd=home)
    assert error["got"] in [finding["what"] for finding in check.json["findings"]]
    assert not (tmp_path / "mark").exists()
