"""Find the binaries that the wheel brings: native FMUs and libraries for every platform.

They are used while the sources they were built from are those that are installed, byte for byte.
A checkout, an editable installation and a wheel built without them have none; then what is needed
is compiled on this machine.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from cosim.core import InputError
from cosim.fmu.export.components import components_folder
from cosim.fmu.inspect.platforms import this_libc, this_machine

MANIFEST = "manifest.json"
_PACKAGE = Path(__file__).parents[2]
_SOURCES = (
    *("fmu/export", "fmu/isolation/channel.c", "master/kernel.c", "models", "network"),
    "scenario/library/designs",
)
"""What decides on the bytes of an FMU or a library, beside the components."""


def prebuilt_folder() -> Path:
    """Return the folder of the prebuilt binaries, whether there is one or not."""
    return _PACKAGE / "prebuilt"


def prebuilt_file(path: str) -> Path | None:
    """Return a prebuilt file if this installation may use it; `path` is below the folder.

    Raises
    ------
    InputError : its bytes are not those that were built.
    """
    if why_none_prebuilt() is not None or path not in _manifest()["files"]:
        return None
    file = prebuilt_folder() / path
    wanted = _manifest()["files"][path]
    found = _sha256(file.read_bytes()) if file.is_file() else "no file"
    if found != wanted:
        raise InputError(
            "a prebuilt binary is damaged",
            where=str(file),
            expected=f"SHA-256 {wanted}",
            got=found,
            hint="install auv-cosim again",
        )
    return file


@cache
def why_none_prebuilt() -> str | None:
    """Return in words why nothing prebuilt is used here; None if it is."""
    if not (prebuilt_folder() / MANIFEST).is_file():
        return "this installation has no prebuilt binaries"
    here = this_machine()
    name = f"{here.architecture}-{here.system}"
    if name not in _manifest()["platforms"]:
        return f"the prebuilt binaries are not for {name}"
    if here.system == "linux" and this_libc() is None:
        return "the prebuilt binaries need the GNU C library"
    if source_digest() != _manifest()["sources"]:
        return "the installed sources are not those of the prebuilt binaries"
    return None


def prebuilt_platforms() -> frozenset[str]:
    """Return what the prebuilt binaries are for; nothing where they may not be used."""
    return frozenset(() if why_none_prebuilt() is not None else _manifest()["platforms"])


@cache
def source_digest() -> str:
    """Return the hash of all sources that decide on the bytes of what is prebuilt."""
    digest = hashlib.sha256()
    for name, path in sorted(_source_files()):
        digest.update(f"{name}\0{_sha256(path.read_bytes())}\0".encode())
    return digest.hexdigest()


def write_manifest(folder: Path, platforms: Sequence[str]) -> None:
    """Write the manifest of a folder of binaries that were built from the present sources."""
    text = json.dumps(_contents(folder, platforms), indent=1) + "\n"
    (folder / MANIFEST).write_text(text, "utf-8", newline="\n")


def is_current(folder: Path, platforms: Sequence[str] | None) -> bool:
    """Whether a folder has just what would be built now, by its manifest.

    platforms : that it is to be for; None: any.
    """
    try:
        found = json.loads((folder / MANIFEST).read_text("utf-8"))
    except (OSError, ValueError):
        return False
    if not isinstance(found, dict):
        return False
    wanted = found.get("platforms", ()) if platforms is None else platforms
    return bool(found == _contents(folder, wanted))


def _contents(folder: Path, platforms: Sequence[str]) -> dict[str, Any]:
    files = {
        path.relative_to(folder).as_posix(): _sha256(path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != MANIFEST
    }
    return {
        "sources": source_digest(),
        "compiler": _compiler(),
        "platforms": [*platforms],
        "files": files,
    }


def _compiler() -> str:
    try:
        return f"ziglang {importlib.metadata.version('ziglang')}"
    except importlib.metadata.PackageNotFoundError:
        return "none"


@cache
def _manifest() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((prebuilt_folder() / MANIFEST).read_text("utf-8"))
    return found


def _source_files() -> Iterator[tuple[str, Path]]:
    """Yield each source with its name in an installed package."""
    folders = {name: _PACKAGE / name for name in _SOURCES} | {"components": components_folder()}
    for name, folder in folders.items():
        if folder.is_file():
            yield name, folder
        for path in folder.rglob("*"):
            if path.is_file() and path.suffix != ".pyc" and not path.name.startswith("."):
                yield f"{name}/{path.relative_to(folder).as_posix()}", path


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
