"""Build FMUs into a folder: fmus/python/NAME.fmu, what is up to date left alone."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from fmu_src.catalogue import CATALOGUE
from fmu_src.python_shell.package import build_python_fmu, guid

FLAVOUR = "python"


@dataclass(frozen=True)
class Built:
    """An FMU that is there now, and whether it had to be made."""

    name: str
    path: Path
    new: bool


def ensure_fmu(name: str, root: Path, *, force: bool = False) -> Built:
    """The FMU `name` of the catalogue under `root`/python, built if missing or out of date.

    Raises
    ------
    KeyError : no such component.
    """
    spec = CATALOGUE[name]
    path = root / FLAVOUR / f"{name}.fmu"
    if not force and path.is_file() and _guid_of(path) == guid(spec):
        return Built(name, path, new=False)
    build_python_fmu(spec, path.parent)
    return Built(name, path, new=True)


def ensure_all(root: Path, names: Iterable[str] = (), *, force: bool = False) -> list[Built]:
    """`ensure_fmu` for the names given, all of the catalogue by default."""
    return [ensure_fmu(name, root, force=force) for name in (names or CATALOGUE)]


def _guid_of(path: Path) -> str | None:
    try:
        with zipfile.ZipFile(path) as archive:
            text = archive.read("modelDescription.xml").decode("utf-8", "replace")
    except (OSError, KeyError, zipfile.BadZipFile):
        return None  # not an FMU: it is built anew
    found = re.search(r'\bguid="([^"]*)"', text)
    return found.group(1) if found else None
