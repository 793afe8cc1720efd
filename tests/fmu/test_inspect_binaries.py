"""The headers of libraries as read here, compared with folders, linkers and nm."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import fmpy
import macholib.mach_o
import macholib.MachO
import pefile
import pytest
from elftools.elf.elffile import ELFFile
from fmu.packed import FMI3, compiled, described, files_of, functions_of_fmi2, pack
from shared import fmu_folder

from cosim.fmu.inspect import inspect_fmu

SHIPPED = Path(fmpy.__file__).parent
FOREIGN = [
    *(SHIPPED / "container_fmu" / "binaries").glob("*/*"),
    *(SHIPPED / "sundials").glob("*/sundials_core.*"),
]
EMPTY = "".join(f"int {name}(void) {{ return 3; }}\n" for name in functions_of_fmi2())


def read_as(name: str, content: bytes, folder: Path) -> Any:
    """What an inspection has of a library, the only one of its FMU: its headers, or why not."""
    files = described(FMI3, "documentation/index.html") | {f"binaries/{name}": content}
    (found,) = inspect_fmu(pack(files, folder / "New.fmu")).binaries
    return found


def read(path: Path, folder: Path) -> Any:
    return read_as(f"x86_64-linux/{path.name}", path.read_bytes(), folder)


@pytest.mark.parametrize("path", FOREIGN, ids=lambda p: f"{p.parent.name}-{p.name}")
def test_architecture_is_that_of_the_folder(path: Path, tmp_path: Path) -> None:
    """FMPy's own libraries are in folders by platform: four systems, three formats."""
    found = read(path, tmp_path)
    assert found.damage is None
    platforms = [f"{i.platform.architecture}-{i.platform.system}" for i in found.images]
    assert path.parent.name in platforms
    assert {image.format for image in found.images} == {
        {".so": "ELF", ".dll": "PE", ".dylib": "Mach-O"}[path.suffix]
    }


LOGGER = SHIPPED / "logging" / "darwin64" / "logging.dylib"
"""Made by Apple's linker for macOS 12: two architectures, each with LC_DYLD_EXPORTS_TRIE."""


def emptied(content: bytes, kind: int, field: int) -> bytes:
    """Each architecture says of its command of this kind that it has no entries: a field is 0."""
    data = bytearray(content)
    (count,) = struct.unpack_from(">I", data, 4)
    for i in range(count):
        (image,) = struct.unpack_from(">I", data, 8 + 20 * i + 8)
        place = image + 32
        for _ in range(struct.unpack_from("<I", data, image + 16)[0]):
            command, size = struct.unpack_from("<II", data, place)
            if command == kind:
                struct.pack_into("<I", data, place + field, 0)
            place += size
    return bytes(data)


def test_the_functions_of_a_stripped_mach_o_library_are_not_checked(tmp_path: Path) -> None:
    """A note says so, and no error that they are missing."""
    whole = read_as("x86_64-darwin/New.dylib", LOGGER.read_bytes(), tmp_path)
    assert (whole.damage, whole.unread) == (None, None)
    assert [i.platform.architecture for i in whole.images] == ["x86_64", "aarch64"]
    content = emptied(LOGGER.read_bytes(), macholib.mach_o.LC_SYMTAB, 12)
    stripped = read_as("x86_64-darwin/New.dylib", content, tmp_path)
    assert [(i.imports, i.exports) for i in stripped.images] == [(frozenset(), None)] * 2
    findings = {}
    for name, data in (("whole", LOGGER.read_bytes()), ("stripped", content)):
        files = described(FMI3, "documentation/index.html")
        files["binaries/x86_64-darwin/New.dylib"] = data
        found = inspect_fmu(pack(files, tmp_path / f"{name}.fmu")).findings
        findings[name] = {f.code: (f.level, f.what) for f in found}
    assert "function-missing" in findings["whole"]
    assert "function-missing" not in findings["stripped"]
    level, what = findings["stripped"]["binary-unexamined"]
    assert (level, "stripped" in what) == ("note", True)


def test_exports_of_a_mach_o_library_come_from_its_symbols(tmp_path: Path) -> None:
    """Older linkers write none."""
    content = emptied(LOGGER.read_bytes(), macholib.mach_o.LC_DYLD_EXPORTS_TRIE, 12)
    bare = read_as("x86_64-darwin/logging.dylib", content, tmp_path)
    assert len(bare.images) == 2
    for image in bare.images:
        assert "addLoggerProxy" in image.exports
        assert all(name.isprintable() and len(name) > 3 for name in image.imports | image.exports)


@pytest.mark.parametrize(
    ("slip", "symbols"), [(None, "TypeError"), ({}.__getitem__, "KeyError")], ids=["type", "key"]
)
def test_fault_of_a_reader_is_not_reported_as_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slip: Any, symbols: str
) -> None:
    """A fault of the reader is a warning of its own; a cut file is still damaged."""
    files = described(FMI3, "documentation/index.html")
    for folder in ("x86_64-darwin", "aarch64-darwin"):
        files[f"binaries/{folder}/New.dylib"] = LOGGER.read_bytes()
    files["binaries/aarch64-darwin/New.dylib"] = LOGGER.read_bytes()[:5000]
    monkeypatch.setattr(macholib.MachO.MachO, "load", slip)
    found = {f.code: f for f in inspect_fmu(pack(files, tmp_path / "New.fmu")).findings}
    assert found["binary-unread"].level == "warning"
    assert found["binary-unread"].where == "binaries/x86_64-darwin/New.dylib"
    assert found["binary-unread"].what.startswith(symbols)
    assert found["binary-damaged"].where == "binaries/aarch64-darwin/New.dylib"


ONE_OF_EACH = {path.suffix: path for path in FOREIGN if path.stem == "container_fmu"}


@pytest.mark.parametrize("suffix", [".so", ".dll", ".dylib"])
def test_damage_is_what_the_headers_announce_and_the_file_lacks(
    suffix: str, tmp_path: Path
) -> None:
    """Half a library is damaged, and so is its beginning; the whole one is not."""
    content = ONE_OF_EACH[suffix].read_bytes()
    for kept in (len(content) // 2, 300, 30):
        found = read_as("x86_64-linux/x.so", content[:kept], tmp_path)
        assert found.damage is not None, kept
        assert (found.unread, found.images) == (None, ())
    assert read_as("x86_64-linux/x.so", content, tmp_path).damage is None


@pytest.mark.parametrize(
    "raised", [ValueError, KeyError, AssertionError, struct.error, MemoryError]
)
def test_no_exception_of_a_reader_is_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raised: type[Exception]
) -> None:
    """Of whatever type, even those that readers raise for damaged files."""

    def slips(*_: Any, **__: Any) -> Any:
        raise raised("a slip")

    monkeypatch.setattr(ELFFile, "__init__", slips)
    monkeypatch.setattr(pefile.PE, "__init__", slips)
    monkeypatch.setattr(macholib.MachO.MachO, "load", slips)
    for path in ONE_OF_EACH.values():
        found = read(path, tmp_path)
        assert found.damage is None
        assert str(found.unread).startswith(raised.__name__.rpartition(".")[2])


def test_a_format_that_is_unknown_here_is_not_damage(tmp_path: Path) -> None:
    """A text is; bytes with a magic number that nobody knows may be a library somewhere."""
    assert read_as("x86_64-linux/x.so", b"#!/bin/sh\n", tmp_path).damage is not None
    assert read_as("x86_64-linux/x.so", b"", tmp_path).damage is not None
    found = read_as("wasm/x.so", b"\xca\xfe\xba\xbf" + bytes(100), tmp_path)
    assert (found.damage, found.images) == (None, ())
    assert "not read here" in str(found.unread)


@pytest.mark.parametrize(
    ("needed", "code"),
    [
        ("KERNEL32.dll", None),
        ("OPENGL32.dll", None),
        ("WINSPOOL.DRV", None),
        ("api-ms-win-core-synch-l1-2-0.dll", None),
        ("MSVCP140_1.dll", None),
        ("mfc140u.dll", None),
        ("mfc140ud.dll", "library-debug"),
        ("VCRUNTIME140D.dll", "library-debug"),
        ("libgcc_s_seh-1.dll", "library-absent"),
        ("libwinpthread-1.dll", "library-absent"),
        ("python311.dll", "needs-python"),
    ],
)
def test_libraries_that_windows_has_are_not_absent(
    needed: str, code: str | None, tmp_path: Path
) -> None:
    """Its own and those of the redistributables; what a compiler of another kind needs is."""
    files = described(FMI3, "documentation/index.html")
    files["binaries/x86_64-windows/New.dll"] = needing(needed)
    report = inspect_fmu(pack(files, tmp_path / "New.fmu"))
    assert needed in report.binaries[0].images[0].libraries
    about = {"library-absent", "library-debug", "library-path", "library-unreached", "needs-python"}
    found = [(each.code, needed in each.what) for each in report.findings if each.code in about]
    assert found == ([] if code is None else [(code, True)])


def needing(library: str) -> bytes:
    """FMPy's library for Windows, which needs this library in place of the first one."""
    with pefile.PE(data=ONE_OF_EACH[".dll"].read_bytes()) as pe:
        place = pe.sections[0].VirtualAddress  # its code, which nobody runs here
        pe.set_bytes_at_rva(place, library.encode() + b"\0")
        pe.DIRECTORY_ENTRY_IMPORT[0].struct.Name = place
        return bytes(pe.write())


@pytest.mark.parametrize("path", [p for p in FOREIGN if p.stem == "container_fmu"], ids=str)
def test_functions_of_a_real_fmu_are_found_on_every_platform(path: Path, tmp_path: Path) -> None:
    """FMPy's container offers FMI 2 and 3 for co-simulation in each of its builds."""
    (image,) = read(path, tmp_path).images
    assert {*functions_of_fmi2()} <= image.exports
    assert not image.needs_python
    other = re.sub(" <(ModelExchange|ScheduledExecution).*?/>", "", FMI3.replace("New", path.stem))
    files = described(other, "documentation/index.html")
    files[f"binaries/{path.parent.name}/{path.name}"] = path.read_bytes()
    report = inspect_fmu(pack(files, tmp_path / "container.fmu"))
    assert report.binaries[0].images[0].functions
    missing = {"function-missing", "needs-python", "binary-name"}
    assert missing.isdisjoint(f.code for f in report.findings)


def test_exports_and_imports_are_those_of_nm(tmp_path: Path) -> None:
    """Compare name by name with nm."""
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("needs nm")
    source = (
        "#include <math.h>\n#include <stdio.h>\n"
        'double f(double x) { puts("f"); return sin(x); } static int g; int *h() { return &g; }'
    )
    path = compiled(tmp_path, source, "small", "-lm")

    def symbols(option: str) -> set[str]:
        line = [nm, "-D", option, "--format=posix", str(path)]
        done = subprocess.run(line, check=True, capture_output=True, text=True)  # noqa: S603 - nm
        rows = [row.split() for row in done.stdout.splitlines()]
        return {name.partition("@")[0] for name, kind, *_ in rows if kind not in "wv"}

    (image,) = read(path, tmp_path).images
    assert {"f", "h"} <= image.exports
    assert image.exports == symbols("--defined-only")
    assert image.imports == symbols("--undefined-only")
    assert image.libraries == ("libm.so.6", "libc.so.6")


def packed(tmp_path: Path, library: Path, **beside: bytes) -> dict[str, list[str]]:
    """Code -> what was found of a WaveField whose only binary is this library."""
    whole = files_of(fmu_folder("native") / "WaveField.fmu")
    files = {
        **{name: content for name, content in whole.items() if not name.startswith("binaries/")},
        "binaries/linux64/WaveField.so": library.read_bytes(),
        **{f"binaries/linux64/{name}.so": content for name, content in beside.items()},
    }
    found: dict[str, list[str]] = {}
    for each in inspect_fmu(pack(files, tmp_path / "WaveField.fmu")).findings:
        if each.code != "binary-here":
            found.setdefault(each.code, []).append(each.what)
    return found


def test_complete_library_has_no_findings(tmp_path: Path) -> None:
    """It exports every function of FMI 2 for co-simulation and needs only the C library."""
    assert packed(tmp_path, compiled(tmp_path, EMPTY, "all")) == {}


def test_missing_functions_are_named(tmp_path: Path) -> None:
    """Without doStep it is useless; without CancelStep strict importers refuse it."""
    source = "".join(
        line for line in EMPTY.splitlines(keepends=True) if "DoStep" not in line
    ).replace("int fmi2CancelStep", "static int fmi2CancelStep")
    found = packed(tmp_path, compiled(tmp_path, source, "part"))
    assert found["function-missing"] == ["fmi2DoStep is not exported"]
    assert found["function-optional"] == ["1 functions are not exported: fmi2CancelStep"]


def test_python_symbols_without_a_python_are_reported(tmp_path: Path) -> None:
    """The cause of `undefined symbol: _Py_NoneStruct` in tools without Python."""
    source = EMPTY + "extern int _Py_NoneStruct; int *take(void) { return &_Py_NoneStruct; }"
    found = packed(tmp_path, compiled(tmp_path, source, "py"))
    assert found["needs-python"] == ["it takes 1 functions from a Python interpreter"]


def test_a_library_beside_must_be_on_the_search_path(tmp_path: Path) -> None:
    """Absent, packed but not found, packed and found by $ORIGIN, an absolute path."""
    helper = compiled(tmp_path, "int help(void) { return 1; }", "libhelp")
    source = EMPTY + "int help(void); int use(void) { return help(); }"
    link = [f"-L{tmp_path}", "-lhelp"]
    plain = compiled(tmp_path, source, "plain", *link)
    assert packed(tmp_path, plain) == {"library-absent": ["it needs libhelp.so"]}
    beside = {"libhelp": helper.read_bytes()}
    assert packed(tmp_path, plain, **beside) == {
        "library-unreached": ["libhelp.so is packed beside it"]
    }
    origin = compiled(tmp_path, source, "origin", *link, "-Wl,-rpath,$ORIGIN")
    assert packed(tmp_path, origin, **beside) == {}
    absolute = compiled(tmp_path, source, "absolute", *link, "-Wl,-rpath,/opt/builder/lib")
    assert packed(tmp_path, absolute)["library-path"] == [
        "it looks for libraries in /opt/builder/lib"
    ]


def test_executable_stack_and_open_symbols(tmp_path: Path) -> None:
    """What new systems refuse, and what clashes with others in one process."""
    source = EMPTY + "".join(f"int helper{i};" for i in range(30))
    found = packed(tmp_path, compiled(tmp_path, source, "stack", "-Wl,-z,execstack"))
    assert found["stack-executable"] == ["it asks for an executable stack"]
    assert found["symbols-open"] == ["it exports 30 symbols besides FMI's"]


def test_program_and_object_file_are_not_libraries(tmp_path: Path) -> None:
    """Both have a library's format but another type."""
    found = packed(tmp_path, compiled(tmp_path, "int f(void) { return 1; }", "f", "-c"))
    assert found["binary-damaged"] == ["an ELF file of type ET_REL, not a shared object"]


@pytest.mark.parametrize(
    ("folder", "source", "expected"),
    [
        ("x86_64-linux", "x86_64-linux/container_fmu.so", None),
        ("aarch64-linux", "x86_64-linux/container_fmu.so", "ELF for x86_64 linux"),
        ("x86_64-windows", "x86_64-windows/container_fmu.dll", None),
        ("x86-windows", "x86_64-windows/container_fmu.dll", "PE for x86_64 windows"),
        ("aarch64-darwin", "aarch64-darwin/container_fmu.dylib", None),
        ("x86_64-darwin", "aarch64-darwin/container_fmu.dylib", "Mach-O for aarch64 darwin"),
        ("x86_64-linux", "aarch64-darwin/container_fmu.dylib", "Mach-O for aarch64 darwin"),
    ],
)
def test_binary_in_the_folder_of_another_machine(
    tmp_path: Path, folder: str, source: str, expected: str | None
) -> None:
    """Architecture and system of the header, not of the name."""
    files = described(FMI3, "documentation/index.html")
    suffix = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}[folder.split("-")[1]]
    content = (SHIPPED / "container_fmu" / "binaries" / source).read_bytes()
    files[f"binaries/{folder}/New{suffix}"] = content
    report = inspect_fmu(pack(files, tmp_path / "New.fmu"))
    found = [f.what for f in report.findings if f.code == "binary-platform"]
    assert found == ([] if expected is None else [expected])


def test_functions_are_not_asked_of_a_folder_that_no_tool_of_fmi3_looks_into(
    tmp_path: Path,
) -> None:
    """Of a library of FMI 2 beside those of FMI 3."""
    files = described(FMI3, "documentation/index.html")
    library = compiled(tmp_path, "int fmi2DoStep(void) { return 0; }", "old").read_bytes()
    files["binaries/linux64/New.so"] = library
    found = {f.code for f in inspect_fmu(pack(files, tmp_path / "New.fmu")).findings}
    assert "function-missing" not in found
    assert "binary-folder" in found
    files["binaries/x86_64-linux/New.so"] = files.pop("binaries/linux64/New.so")
    found = {f.code for f in inspect_fmu(pack(files, tmp_path / "New.fmu")).findings}
    assert "function-missing" in found


def test_glibc_newer_than_this_machine(fmus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """PythonFMU's library on machines of 2018 and 2022, and on one without glibc."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    for libc, known in (("glibc", "2.27"), ("glibc", "2.9"), ("glibc", "2.35"), ("", "")):
        monkeypatch.setattr("platform.libc_ver", lambda libc=libc, known=known: (libc, known))
        findings = inspect_fmu(fmus / "WaveField.fmu").findings
        found = [f.what for f in findings if f.code == "libc-here"]
        old = known in ("2.27", "2.9")
        assert found == [f"it needs glibc 2.32, this machine has {known}"] * old


def test_glibc_that_is_needed(fmus: Path) -> None:
    """PythonFMU's library names GLIBC_2.32 as its newest symbol version."""
    content = files_of(fmus / "WaveField.fmu")["binaries/linux64/WaveField.so"]
    report = inspect_fmu(fmus / "WaveField.fmu")
    (image,) = next(b.images for b in report.binaries if b.name.endswith(".so"))
    assert image.libc == max(
        tuple(map(int, word.split(b"\0")[0].split(b".")))
        for word in content.split(b"GLIBC_")[1:]
        if word[:1].isdigit()
    )
