"""What a wheel brings is used where its bytes belong to the sources, and never in silence."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from shared import copied, fmu_folder
from tape_binaries import binary_of

from cosim.core import InputError
from cosim.fmu import (
    build_fmu,
    compiled_library,
    ensure_fmu,
    is_prebuilt,
    library_source,
    prebuilt,
    why_none_prebuilt,
)
from cosim.fmu.export.native.platforms import host
from cosim.master import load_kernel
from cosim.scenario import FmuCache, execute_unrecorded, parse, prepare

CACHED = (prebuilt.why_none_prebuilt, prebuilt.source_digest, prebuilt._manifest)


@pytest.fixture
def wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of a wheel for this machine, with one FMU, one library, one binary of a kind."""
    folder = tmp_path / "prebuilt"
    copied(fmu_folder("native") / "PaperController.fmu", made(folder / "native"))
    library = made(folder / prebuilt_name("kernel", library_source("kernel")))
    library.write_bytes(b"a library")
    kind = made(folder / f"binaries/fmi2/{host().tuple_name}/feedback{host().suffix}")
    kind.write_bytes(binary_of("feedback"))
    monkeypatch.setattr(prebuilt, "prebuilt_folder", lambda: folder)
    forget()
    prebuilt.write_manifest(folder, [host().tuple_name])
    yield folder
    forget()


def made(path: Path) -> Path:
    """The path in a folder that exists; a folder becomes that of the FMU."""
    path = path if path.suffix else path / "PaperController.fmu"
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def prebuilt_name(name: str, source: bytes) -> str:
    from cosim.fmu.compiled import _prebuilt_name  # noqa: PLC0415

    return _prebuilt_name(name, source, host())


def forget() -> None:
    for function in CACHED:
        function.cache_clear()


def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")


def test_the_fmu_of_the_wheel_is_used_where_it_lies(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is written, nothing compiled; a copy where a folder is asked for."""
    without_compiler(monkeypatch)
    assert why_none_prebuilt() is None
    found = ensure_fmu("PaperController", tmp_path / "fmus")
    assert (found.path, found.new) == (wheel / "native" / "PaperController.fmu", False)
    assert not (tmp_path / "fmus").exists()
    copy = build_fmu("PaperController", tmp_path / "own")
    assert copy.read_bytes() == found.path.read_bytes()
    with pytest.raises(InputError, match="need a C compiler"):
        ensure_fmu("PaperController", tmp_path / "fmus", flavour="native-fmi3")
    with pytest.raises(InputError, match="need a C compiler"):
        build_fmu("PaperController", tmp_path / "own", prebuilt=False)


def test_an_own_gain_needs_no_compiler(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The binary of its kind is in the FMU; a kind that the wheel has none of is compiled."""
    from cosim.fmu import CATALOGUE  # noqa: PLC0415

    without_compiler(monkeypatch)
    path = build_fmu(CATALOGUE["HinfController"], tmp_path / "own")
    binary = next(wheel.glob("binaries/**/feedback*")).read_bytes()
    assert binary in path.read_bytes()
    with pytest.raises(InputError, match="need a C compiler"):
        build_fmu(CATALOGUE["DelayedPlant"], tmp_path / "own")


def test_the_kernel_of_the_wheel_belongs_to_its_source(wheel: Path) -> None:
    """By name: with another source there is none."""
    assert wheel.is_dir()
    assert is_prebuilt("kernel", library_source("kernel"))
    assert not is_prebuilt("kernel", library_source("kernel") + b"\n")
    with pytest.raises(OSError, match="kernel"):  # it is taken, and no library
        compiled_library.__wrapped__("kernel", library_source("kernel"))


def test_sources_that_were_changed_say_so(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An edited component is compiled; without a compiler the message has the reason."""
    manifest = json.loads((wheel / "manifest.json").read_text())
    manifest["sources"] = hashlib.sha256(b"other").hexdigest()
    (wheel / "manifest.json").write_text(json.dumps(manifest))
    forget()
    without_compiler(monkeypatch)
    with pytest.raises(InputError, match="sources are not those of the prebuilt binaries"):
        ensure_fmu("PaperController", tmp_path / "fmus")


@pytest.mark.parametrize("content", [b"", None])
def test_a_damaged_binary_is_an_error(wheel: Path, tmp_path: Path, content: bytes | None) -> None:
    """It is neither used nor replaced in silence."""
    file = wheel / "native" / "PaperController.fmu"
    file.chmod(0o644)
    file.unlink() if content is None else file.write_bytes(content)
    with pytest.raises(InputError, match=r"binary is damaged[\s\S]*install auv-cosim again"):
        ensure_fmu("PaperController", tmp_path / "fmus")


def test_another_machine_has_none(wheel: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A platform that was not built for, or a C library that is not GNU's."""
    assert wheel.is_dir()
    prebuilt.why_none_prebuilt.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr("platform.machine", lambda: "riscv64")
        assert "are not for riscv64" in str(why_none_prebuilt())
    prebuilt.why_none_prebuilt.cache_clear()
    monkeypatch.setattr("platform.libc_ver", lambda: ("", ""))
    assert "need the GNU C library" in str(why_none_prebuilt())


def test_the_digest_is_of_what_decides_on_the_bytes() -> None:
    """Equations, C, tables, pages and designs; nothing that Python leaves beside them."""
    names = {name for name, _ in prebuilt._source_files()}
    assert {
        *("fmu/export/native/c/tape.c", "models/auv.py", "components/auv_plant/variables.py"),
        *("components/auv_plant/readme.md", "scenario/library/designs/auv-1.25s.json"),
        *("master/kernel.c", "fmu/isolation/channel.c", "network/stepping.py"),
    } <= names
    assert not any(".pyc" in name for name in names)


@pytest.fixture
def kernel() -> None:
    """The kernel is loaded, before a wheel brings another file in its place."""
    load_kernel()


TWO = """
title = "Two controllers"
[run]
end = 1.0
step = 0.1
[components.a]
fmu = "PaperController"
[components.b]
fmu = "own/mine.fmu"
"""


@pytest.mark.usefixtures("kernel")
def test_origins_are_named(wheel: Path, tmp_path: Path) -> None:
    """The summary of a run says of each binary where it is from."""
    (tmp_path / "own").mkdir()
    copied(wheel / "native" / "PaperController.fmu", tmp_path / "own" / "mine.fmu")
    loaded = parse(TWO, name="two", where="two.toml", folder=tmp_path)
    prepared = prepare(loaded, FmuCache(tmp_path / "fmus", tmp_path, flavour="native"))
    outcome, _ = execute_unrecorded(prepared, engine="kernel")
    assert outcome.binaries["the kernel"] == "prebuilt"
    assert outcome.binaries["b"] == f"from {tmp_path / 'own'}"
