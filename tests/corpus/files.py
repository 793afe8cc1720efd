"""The files of the corpus: where they are kept, and unpacked for the tests of a session."""

from __future__ import annotations

import lzma
import shutil
from pathlib import Path

from shared import made_once

HERE = Path(__file__).parent
PACKED = ("*.fmu.xz", "*.mcap.xz", "*.partial.xz", "*.ssp.xz", "not-proved.json.xz")
"""Kept packed: they are large, or no test that looks for files of their kind is to find them."""
SOURCES = ("systems", "scenarios", "studies")
"""Folders of files that are written by hand."""
FOLDERS = (
    *SOURCES,
    "certificates",
    "flight",
    "fmus",
    "links",
    "results",
    "ssp",
    "store",
    "traces",
    "vehicles",
)


def kept() -> list[str]:
    """Every file of the corpus by its name once unpacked, in order."""
    files = (path for name in FOLDERS for path in (HERE / name).rglob("*") if path.is_file())
    return sorted(path.relative_to(HERE).as_posix().removesuffix(".xz") for path in files)


def corpus() -> Path:
    """The folder with all files unpacked, made once per session; read only."""
    return made_once("corpus", _unpack)


def _unpack(folder: Path) -> None:
    for name in kept():
        target, source = folder / name, HERE / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_file():
            shutil.copyfile(source, target)
        else:
            target.write_bytes(lzma.decompress(Path(f"{source}.xz").read_bytes()))
