"""What a wheel brings is used where its bytes belong to the sources, and never in silence."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
import zlib
from pathlib import Path
from typing import Any

import pytest
from shared import copied, fmu_folder, made_once
from wheel import NO_COMPILER, binary_of, cross_compiled, installed, python

BEGIN = """\
import json, sys
from pathlib import Path
from cosim.core import InputError
from cosim.fmu import *
from cosim.fmu.compiled import *
from cosim.fmu.export import *
wheel, own = Path(sys.argv[1], "cosim", "prebuilt"), Path(sys.argv[2])
def refused(call, *given, **named):
    try:
        call(*given, **named)
    except InputError as error:
        return error.text()
"""
KERNEL = """\
from cosim.fmu.compiled import library_source, write_library
from cosim.fmu.export import host
write_library("kernel", library_source("kernel"), folder, host())
"""


def kernel() -> dict[str, bytes]:
    """The library of the loops, by its place among what is prebuilt."""
    folder = made_once("wheel/kernel", lambda it: cross_compiled(KERNEL, it))
    (path,) = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes()}


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    """An installed package for this machine: native FMUs, a library, a binary of a kind."""
    fmus = {f"native/{path.name}": path.read_bytes() for path in fmu_folder("native").glob("*.fmu")}
    return installed(tmp_path / "site", {**fmus, **kernel(), **binary_of("sampled")})


def found_by(wheel: Path, code: str, own: Path | None = None, **environment: str) -> Any:
    """What Python finds there without a compiler: the value of `found` after some code."""
    done = python(
        f"{BEGIN}{code}\nprint(json.dumps(found, default=str))",
        *(str(wheel), str(own or wheel.parent / "own")),
        packages=[wheel],
        **{**NO_COMPILER, **environment},
    )
    assert done.returncode == 0, done.stderr.decode()
    return json.loads(done.stdout)


def why_none(wheel: Path, before: str = "") -> str | None:
    """Why the prebuilt FMU is not used there, after some code; None if it is."""
    code = 'found = refused(ensure_fmu, "PaperController", own / "fmus")'
    found: str | None = found_by(wheel, f"{before}\n{code}")
    assert found is None or "need a C compiler" in found
    return found


def test_the_fmu_of_the_wheel_is_used_where_it_lies(wheel: Path) -> None:
    """Nothing is written, nothing compiled; a copy where a folder is asked for."""
    code = """
fmu = ensure_fmu("PaperController", own / "fmus")
found = {
    "where": [fmu.path == wheel / "native" / "PaperController.fmu", fmu.new],
    "written": (own / "fmus").exists(),
    "same": build_fmu("PaperController", own / "copy").read_bytes() == fmu.path.read_bytes(),
    "refused": [
        refused(ensure_fmu, "PaperController", own / "fmus", flavour="native-fmi3"),
        refused(build_fmu, "PaperController", own / "built", prebuilt=False),
    ],
}
"""
    found = found_by(wheel, code)
    assert all("need a C compiler" in str(each) for each in found.pop("refused"))
    assert found == {"where": [True, False], "written": False, "same": True}


def test_an_own_gain_needs_no_compiler(wheel: Path, tmp_path: Path) -> None:
    """The binary of its kind is in the FMU; a kind that the wheel has none of is compiled.

    The wheel has it compressed.
    """
    code = """
found = [
    build_fmu(CATALOGUE["HinfController"], own),
    refused(build_fmu, CATALOGUE["DelayedPlant"], own),
]
"""
    path, refused = found_by(wheel, code, tmp_path)
    binary = zlib.decompress(*binary_of("sampled").values())
    with zipfile.ZipFile(path) as archive:
        assert [archive.read(n) for n in archive.namelist() if n.startswith("binaries/")] == [
            binary
        ]
    assert "need a C compiler" in refused


def test_all_platforms_without_a_cross_compiler(wheel: Path) -> None:
    """They are the prebuilt ones where these are for all; else it is said what to do."""
    code = """
sys.modules["ziglang"] = None
def made(flavour, **named):
    kind = target_named(flavour, "all", **named)
    return refused(write_fmu, CATALOGUE["HinfController"], own / "some.fmu", kind)
clocked = made("native-fmi3", clocked=True)
found = [made("native"), clocked, target_named("native", "all").prebuilt]
"""
    some = found_by(wheel, code)
    every = (
        "from cosim.fmu.compiled import write_manifest",
        "write_manifest(wheel, list(PLATFORMS))",
        code,
    )
    all_of_them = found_by(wheel, "\n".join(every))
    changed = "from cosim.fmu.compiled import prebuilt\nprebuilt._SOURCES = ('models',)"
    other = found_by(wheel, f"{changed}\n{code}")
    assert [one[2] for one in (some, all_of_them, other)] == [False, True, False]
    assert all_of_them[0] is None
    for refusal in (some[0], some[1], all_of_them[1], other[0]):
        assert "FMUs for other platforms need a cross compiler" in refusal
        assert "pip install 'auv-cosim[cross]', or " in refusal
    assert "--platforms prebuilt, which has binaries" in some[0]
    assert "the installed sources are not those of the prebuilt binaries" in other[0]
    assert "install the wheel: its FMUs have binaries for all platforms" in other[0]


def test_the_kernel_of_the_wheel_belongs_to_its_source(wheel: Path) -> None:
    """By name: with another source there is none."""
    code = """
source = library_source("kernel")
library = compiled_library("kernel", source)
found = [
    is_prebuilt("kernel", source),
    Path(library._name).is_relative_to(wheel),
    is_prebuilt("kernel", source + b"\\n"),
    refused(compiled_library, "kernel", source + b"\\n"),
]
"""
    cache = str(wheel / "cache")  # what this machine has compiled before is in another one
    *taken, refused = found_by(wheel, code, XDG_CACHE_HOME=cache)
    assert taken == [True, True, False]
    assert "need a C compiler" in refused


def test_sources_that_were_changed_say_so(wheel: Path) -> None:
    """An edited component is compiled; without a compiler the message has the reason."""
    path = wheel / "cosim" / "prebuilt" / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["sources"] = hashlib.sha256(b"other").hexdigest()
    path.write_text(json.dumps(manifest))
    assert "sources are not those of the prebuilt binaries" in str(why_none(wheel))


@pytest.mark.parametrize("content", [b"", None])
def test_a_damaged_binary_is_an_error(wheel: Path, content: bytes | None) -> None:
    """It is neither used nor replaced in silence."""
    file = wheel / "cosim" / "prebuilt" / "native" / "PaperController.fmu"
    file.unlink() if content is None else file.write_bytes(content)
    found = found_by(wheel, 'found = refused(ensure_fmu, "PaperController", own)')
    assert "binary is damaged" in found
    assert "install auv-cosim again" in found.partition("binary is damaged")[2]


def test_another_machine_has_none(wheel: Path) -> None:
    """A platform that was not built for, or a C library that is not GNU's."""
    begin = "import platform; platform."
    assert why_none(wheel) is None
    other = why_none(wheel, f'{begin}machine = lambda: "riscv64"')
    assert "are not for riscv64" in str(other)
    assert "need the GNU C library" in str(why_none(wheel, f'{begin}libc_ver = lambda: ("", "")'))


def test_the_sources_are_all_that_decides_on_the_bytes(tmp_path: Path) -> None:
    """Equations, C, tables, pages and designs; nothing that Python leaves beside them."""
    name = "native/PaperController.fmu"
    content = (fmu_folder("native") / "PaperController.fmu").read_bytes()
    wheel = installed(tmp_path / "site", {name: content})
    package = wheel / "cosim"
    for name in ("fmu", "master", "models", "network", "scenario", "components"):
        source = (package / name).readlink()
        (package / name).unlink()
        shutil.copytree(source, package / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in (
        *("fmu/export/native/c/tape.c", "models/auv.py", "components/auv_plant/variables.py"),
        *("components/auv_plant/readme.md", "scenario/library/designs/auv-1.25s.json"),
        *("master/kernel.c", "fmu/isolation/channel.c", "network/stepping.py"),
    ):
        content = (package / name).read_bytes()
        (package / name).write_bytes(content + b"\n")
        assert "sources are not those" in str(why_none(wheel)), name
        (package / name).write_bytes(content)
    for name in ("models/left.pyc", "models/.hidden", "master/session.py"):
        with (package / name).open("ab") as file:
            file.write(b"\n")
    assert why_none(wheel) is None


def test_origins_are_named(wheel: Path, tmp_path: Path) -> None:
    """The summary of a run says of each binary where it is from."""
    own = tmp_path / "fmus"
    copied(fmu_folder("native") / "PaperController.fmu", made(own / "native"))
    words = ["run", "paper-example", "--json", "--until", "0.1", "--fmus", str(own)]
    command = "from cosim.cli.entry import main; main()"
    done = python(command, *words, packages=[wheel], folder=tmp_path, **NO_COMPILER)
    assert done.returncode in (0, 1), done.stderr.decode()
    found = json.loads(done.stdout)["binaries"]
    assert found["the kernel"] == found["plant"] == "prebuilt"
    assert found["controller"] == f"from {own / 'native'}"


def made(folder: Path) -> Path:
    """The place of the FMU in a folder that exists."""
    folder.mkdir(parents=True)
    return folder / "PaperController.fmu"
