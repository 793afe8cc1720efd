"""The GUID of an FMU as the present code would build it, kept from one process to the next.

It is a hash over everything that is in the FMU, its pages included, which takes longer than a
short run. It is computed again when a file that decides on it has another size or time.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from cosim.core import write_whole
from cosim.fmu.export.components import components_folder

_PACKAGE = Path(__file__).parents[2]
_SOURCES = ("fmu", "hinf/certificate", "models", "network", "scenario/library/designs")
_OTHERS = ("pythonfmu", "markdown_it", "latex2mathml")
"""Packages whose version decides on the content of an FMU."""


def kept_guid(key: str, folder: Path, compute: Callable[[], str]) -> str:
    """Return the GUID that is kept under `key` for the present sources; else compute and keep it.

    `folder` : where GUIDs are kept; one that cannot be written costs time, and nothing else.
    """
    # of this installation: others have other sources, and would replace the file in turn
    path = folder / f"guids-{hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:12]}.json"
    now = _sources_state()
    known: dict[str, str] = {}
    # absent, of other sources, or not ours: as if there were none
    with suppress(OSError, ValueError, KeyError, TypeError):
        kept = json.loads(path.read_text("utf-8"))
        if kept["sources"] == now:
            known = {name: str(guid) for name, guid in kept["guids"].items()}
    if key in known:
        return known[key]
    found = compute()
    content = {"sources": now, "guids": {**known, key: found}}
    with suppress(OSError):
        write_whole(path, json.dumps(content, indent=1).encode())
    return found


@functools.cache
def _sources_state() -> str:
    """Return a hash of names, sizes and times of all files that decide on the content of FMUs."""
    digest = hashlib.sha256()
    for path in _files():
        status = os.stat(path)  # noqa: PTH116 - hundreds of paths: objects take longer than the rest
        digest.update(f"{path}\0{status.st_size}\0{status.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _files() -> Iterator[str]:
    for folder in (*(_PACKAGE / name for name in _SOURCES), components_folder()):
        for root, folders, names in os.walk(folder):
            folders[:] = sorted(name for name in folders if name != "__pycache__")
            yield from (f"{root}/{name}" for name in sorted(names))
    for package in _OTHERS:
        found = find_spec(package)
        if found is not None and found.origin is not None:
            yield found.origin
