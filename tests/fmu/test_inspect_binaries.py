"""The headers of libraries as read here, compared with folders, linkers and nm."""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import fmpy
import macholib.mach_o
import macholib.MachO
import pytest
from fmu.packed import FMI3, compiled, described, files_of, pack
from macholib.ptypes import Structure, p_uint32

from cosim.fmu import component_module, inspect_fmu
from cosim.fmu.export.model_description import fmi2_xml
from cosim.fmu.inspect import binaries, macho
from cosim.fmu.inspect.fmi_functions import functions
from cosim.fmu.inspect.image import Image
from cosim.fmu.inspect.library import Binary, read_binary
from cosim.fmu.inspect.platforms import Platform, named_by_tuple, this_libc, this_machine

SPEC = component_module("wave_field.variables").SPEC

SHIPPED = Path(fmpy.__file__).parent
FOREIGN = [
    *(SHIPPED / "container_fmu" / "binaries").glob("*/*"),
    *(SHIPPED / "sundials").glob("*/sundials_core.*"),
]
EMPTY = "".join(
    f"int {name}(void) {{ return 3; }}\n"
    for name in sorted({n for part in functions(2, "co-simulation", "") for n in part})
)


def read(path: Path) -> Binary:
    return read_binary("linux64", path.name, path.read_bytes())


@pytest.mark.parametrize("path", FOREIGN, ids=lambda p: f"{p.parent.name}-{p.name}")
def test_architecture_is_that_of_the_folder(path: Path) -> None:
    """FMPy's own libraries are in folders by platform: four systems, three formats."""
    found = read(path)
    assert found.damage is None
    assert named_by_tuple(path.parent.name) in [image.platform for image in found.images]
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


@pytest.mark.parametrize("spelling", ["datasize", "datassize"])
def test_exports_of_a_stripped_mach_o_library_come_from_its_trie(
    monkeypatch: pytest.MonkeyPatch, spelling: str
) -> None:
    """The field of the trie's size is read under both spellings that releases of macholib use."""

    class LinkEditData(Structure):  # type: ignore[misc]
        _fields_ = (("dataoff", p_uint32), (spelling, p_uint32))

    kind = macholib.mach_o.LC_DYLD_EXPORTS_TRIE
    monkeypatch.setitem(macholib.MachO.LC_REGISTRY, kind, LinkEditData)
    whole = read(LOGGER)
    assert (whole.damage, whole.unread) == (None, None)
    assert [i.platform.architecture for i in whole.images] == ["x86_64", "aarch64"]
    content = emptied(LOGGER.read_bytes(), macholib.mach_o.LC_SYMTAB, 12)
    stripped = read_binary("darwin64", "logging.dylib", content)
    assert [i.imports for i in stripped.images] == [frozenset(), frozenset()]
    for image, bare in zip(whole.images, stripped.images, strict=True):
        assert "addLoggerProxy" in bare.exports
        assert bare.exports == image.exports


def test_exports_of_a_mach_o_library_without_a_trie_come_from_its_symbols() -> None:
    """Older linkers write none."""
    content = emptied(LOGGER.read_bytes(), macholib.mach_o.LC_DYLD_EXPORTS_TRIE, 12)
    bare = read_binary("darwin64", "logging.dylib", content)
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
    monkeypatch.setattr(macho, "exported_names", slip)
    found = {f.code: f for f in inspect_fmu(pack(files, tmp_path / "New.fmu")).findings}
    assert found["binary-unread"].level == "warning"
    assert found["binary-unread"].where == "binaries/x86_64-darwin/New.dylib"
    assert found["binary-unread"].what.startswith(symbols)
    assert found["binary-damaged"].where == "binaries/aarch64-darwin/New.dylib"


ONE_OF_EACH = {path.suffix: path for path in FOREIGN if path.stem == "container_fmu"}


@pytest.mark.parametrize("suffix", [".so", ".dll", ".dylib"])
def test_damage_is_what_the_headers_announce_and_the_file_lacks(suffix: str) -> None:
    """Half a library is damaged, and so is its beginning; the whole one is not."""
    content = ONE_OF_EACH[suffix].read_bytes()
    for kept in (len(content) // 2, 300, 30):
        found = read_binary("linux64", "x", content[:kept])
        assert found.damage is not None, kept
        assert (found.unread, found.images) == (None, ())
    assert read_binary("linux64", "x", content).damage is None


@pytest.mark.parametrize(
    "raised", [ValueError, KeyError, AssertionError, struct.error, MemoryError]
)
def test_no_exception_of_a_reader_is_damage(
    monkeypatch: pytest.MonkeyPatch, raised: type[Exception]
) -> None:
    """Of whatever type, even those that readers raise for damaged files."""

    def reader(kind: str) -> Any:
        def read_it(_: Any) -> Any:
            raise raised(kind)

        return read_it

    monkeypatch.setattr("cosim.fmu.inspect.library._reader", reader)
    for path in ONE_OF_EACH.values():
        found = read(path)
        assert found.damage is None
        assert str(found.unread).startswith(raised.__name__.rpartition(".")[2])


def test_a_format_that_is_unknown_here_is_not_damage() -> None:
    """A text is; bytes with a magic number that nobody knows may be a library somewhere."""
    assert read_binary("linux64", "x", b"#!/bin/sh\n").damage is not None
    assert read_binary("linux64", "x", b"").damage is not None
    found = read_binary("wasm", "x", b"\xca\xfe\xba\xbf" + bytes(100))
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
def test_libraries_that_windows_has_are_not_absent(needed: str, code: str | None) -> None:
    """Its own and those of the redistributables; what a compiler of another kind needs is."""
    image = Image("PE", Platform("windows", "x86_64"), frozenset(), frozenset(), (needed,))
    found = [each.code for each in binaries._library("x.dll", image, needed, set())]
    assert found == ([] if code is None else [code])


@pytest.mark.parametrize("path", [p for p in FOREIGN if p.stem == "container_fmu"], ids=str)
def test_functions_of_a_real_fmu_are_found_on_every_platform(path: Path) -> None:
    """FMPy's container offers FMI 2 and 3 for co-simulation in each of its builds."""
    (image,) = read(path).images
    assert functions(2, "co-simulation", "").core <= image.exports
    assert functions(3, "co-simulation", "").core <= image.exports
    assert not image.needs_python


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

    (image,) = read(path).images
    assert {"f", "h"} <= image.exports
    assert image.exports == symbols("--defined-only")
    assert image.imports == symbols("--undefined-only")
    assert image.libraries == ("libm.so.6", "libc.so.6")


def packed(tmp_path: Path, library: Path, **beside: bytes) -> dict[str, list[str]]:
    """Code -> what was found of a WaveField whose only binary is this library."""
    files = {
        "modelDescription.xml": fmi2_xml(SPEC, "{1}", tool="a test", needs_tool=False),
        "documentation/index.html": b"",
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
    """PythonFMU's library on a machine of 2018; the real machine's own is read as it is."""
    path = fmus / "WaveField.fmu"
    assert this_machine().system != "linux" or this_libc() is None or this_libc() >= (2, 17)
    monkeypatch.setattr("cosim.fmu.inspect.binaries.this_libc", lambda: (2, 27))
    monkeypatch.setattr(
        "cosim.fmu.inspect.binaries.this_machine", lambda: Platform("linux", "x86_64")
    )
    found = [f.what for f in inspect_fmu(path).findings if f.code == "libc-here"]
    assert found == ["it needs glibc 2.32, this machine has 2.27"]


def test_glibc_that_is_needed(fmus: Path) -> None:
    """PythonFMU's library names GLIBC_2.32 as its newest symbol version."""
    content = files_of(fmus / "WaveField.fmu")["binaries/linux64/WaveField.so"]
    (image,) = read_binary("linux64", "WaveField.so", content).images
    assert image.libc == max(
        tuple(map(int, word.split(b"\0")[0].split(b".")))
        for word in content.split(b"GLIBC_")[1:]
        if word[:1].isdigit()
    )
