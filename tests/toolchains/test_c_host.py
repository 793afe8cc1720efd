"""A host in C, no Python in its process: loads a native FMU, runs, saves, restores, goes on."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path

import pytest
from c_compiler import c_compiler, compile_c
from fmpy import read_model_description
from shared import fmu_folder, sampled

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, PLATFORMS, Platform, host

HERE = Path(__file__).resolve().parent
NAMES = sorted(CATALOGUE)
SANITIZERS = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="the host opens libraries by dlopen"
)


def sources_of(path: Path, folder: Path) -> tuple[Path, list[str]]:
    """A folder with the sources of an FMU, and the names of those to compile."""
    inside = folder / path.stem
    inside.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.startswith("sources/"):
                (inside / Path(name).name).write_bytes(archive.read(name))
    return inside, sorted(file.name for file in inside.glob("*.c"))


def compiled_host(folder: Path, *options: str, compiler: Sequence[str] = ()) -> Path:
    program = folder / "host"
    headers, _ = sources_of(fmu_folder("native") / "AuvPlant.fmu", folder / "headers")
    command = [*(compiler or c_compiler()), "-std=c99", "-D_DEFAULT_SOURCE"]
    command += [
        "-Wall",
        "-Wextra",
        "-Werror",
        *options,
        f"-I{headers}",
        str(HERE / "host.c"),
        "-o",
        str(program),
        "-ldl",
        "-lm",
    ]
    subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603
    return program


def arguments(path: Path) -> list[str]:
    """GUID, a Real input or -, the Real outputs."""
    model = read_model_description(str(path))
    by = {
        causality: [str(v.valueReference) for v in model.modelVariables if v.causality == causality]
        for causality in ("input", "output")
    }
    return [model.guid, (by["input"] or ["-"])[0], *by["output"]]


def run(program: Path, library: Path, *words: str, under: Sequence[str] = ()) -> list[float]:
    done = subprocess.run(  # noqa: S603
        [*under, str(program), str(library), *words],
        check=False,
        capture_output=True,
        text=True,
        env={"PATH": "", "ASAN_OPTIONS": "detect_leaks=1"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return [float.fromhex(line) for line in done.stdout.split()]


def library_of(path: Path, folder: Path, platform: Platform | None = None) -> Path:
    """The library of an FMU for a platform; None: for this machine."""
    built_for = platform or host()
    with zipfile.ZipFile(path) as archive:
        name = f"binaries/{built_for.fmi2}/{path.stem}{built_for.suffix}"
        return Path(archive.extract(name, folder))


def python_in(program: Path) -> bool:
    """Whether anything that a program loads is Python."""
    listed = subprocess.run(  # noqa: S603
        ["ldd", str(program)],  # noqa: S607
        check=True,
        capture_output=True,
        text=True,
    )
    return "python" in listed.stdout.lower()


@pytest.mark.parametrize("name", NAMES)
def test_c_host_runs_saves_restores(native_fmus: Path, tmp_path: Path, name: str) -> None:
    """Restored, carried over as bytes, reset: the same bits each time; outputs move."""
    program = compiled_host(tmp_path)
    library = library_of(native_fmus / f"{name}.fmu", tmp_path)
    outputs = run(program, library, *arguments(native_fmus / f"{name}.fmu"))
    assert any(outputs)
    if shutil.which("ldd"):
        assert not python_in(program)
        assert not python_in(library)


@pytest.mark.parametrize("flavour", ["native", "native-fmi3"])
def test_sources_have_no_warning(tmp_path: Path, flavour: str) -> None:
    """Of any component: users compile the sources with their own warnings, errors among them."""
    warnings = {}
    for name in NAMES:
        inside, files = sources_of(fmu_folder(flavour) / f"{name}.fmu", tmp_path)
        words = ["-std=c99", "-fsyntax-only", "-Wall", "-Wextra", *files]
        warnings[name] = compile_c(*words, folder=inside)
    assert warnings == dict.fromkeys(NAMES, "")


@pytest.mark.skipif(platform.system() != "Linux", reason="the sanitizers of the system's compiler")
@pytest.mark.parametrize(
    "name", sampled(["HinfController", "AuvPlant", "DelayedPlant", "WaveField"], 2)
)
def test_no_memory_error_and_no_leak(native_fmus: Path, tmp_path: Path, name: str) -> None:
    """The same run under the address and undefined-behaviour sanitizers, leaks included."""
    path = native_fmus / f"{name}.fmu"
    words = arguments(path)
    inside, files = sources_of(path, tmp_path)
    library = tmp_path / "model.so"
    compile_c(
        *("-std=c99", "-O1", "-fPIC", "-shared", "-Wall", "-Wextra", "-Werror", *SANITIZERS),
        *(*files, "-o", str(library), "-lm"),
        folder=inside,
    )
    checked = run(compiled_host(tmp_path, *SANITIZERS), library, *words)
    plain = run(compiled_host(tmp_path), library_of(path, tmp_path), *words)
    assert checked == plain


ARM = PLATFORMS["aarch64-linux"]
ARM_ROOT = Path(os.environ.get("QEMU_LD_PREFIX", "/usr/aarch64-linux-gnu"))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("qemu-aarch64") is None, reason="needs Debian's qemu-user")
@pytest.mark.skipif(not ARM_ROOT.is_dir(), reason="needs Debian's libc6-arm64-cross")
@pytest.mark.parametrize("name", NAMES)
def test_c_host_on_another_machine(native_fmus: Path, tmp_path: Path, name: str) -> None:
    """The aarch64 binary in a host for aarch64: it restores to the bit; the results are these.

    Across machines the C library's pow and sin may differ in the last bit.
    """
    pytest.importorskip("ziglang")
    path = native_fmus / f"{name}.fmu"
    words = arguments(path)
    here = run(compiled_host(tmp_path), library_of(path, tmp_path), *words)
    library = library_of(build_fmu(CATALOGUE[name], tmp_path, "native", [ARM]), tmp_path, ARM)
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", ARM.zig]
    program = compiled_host(tmp_path, compiler=compiler)
    qemu = [str(shutil.which("qemu-aarch64")), "-L", str(ARM_ROOT)]
    there = run(program, library, *words, under=qemu)
    assert there == pytest.approx(here, rel=1e-12, abs=1e-300)
