"""What the tests of a session share: made once for all its processes, and only read afterwards.

Whoever writes has a folder of his own (`tmp_path`). What is shared is made read-only, and
`what_was_written` finds a writer that may write everywhere, such as root.
"""

from __future__ import annotations

import json
import os
import shutil
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from locket import lock_file

_NO_WRITE = ~0o222
_WHOLE, _SLASH = ".whole", "~"
_session: list[Path] = []


_EACH = 64
"""One slow test of so many is run per commit; a family of them has been cut to its share before."""


def share_of(members: Iterable[Any]) -> list[Any]:
    """All of them, or with SHARE=K/N in the environment the K-th of every N, at least one."""
    first, number = map(int, os.environ.get("SHARE", "0/1").split("/"))
    found = [*members]
    number = min(number, len(found)) or 1
    return found[first % number :: number]


def is_in_share(name: str) -> bool:
    """Whether SHARE=K/N has the slow test of this name run; all of them without it."""
    share = os.environ.get("SHARE")
    return share is None or (zlib.crc32(name.encode()) - int(share.split("/")[0])) % _EACH == 0


def slow_share_of(members: Iterable[Any]) -> list[Any]:
    """A share of them, as parameters of slow tests."""

    def slow(one: Any) -> Any:
        if hasattr(one, "marks"):  # it is pytest.param(...)
            return pytest.param(*one.values, marks=[*one.marks, pytest.mark.slow], id=one.id)
        return pytest.param(*(one if type(one) is tuple else (one,)), marks=pytest.mark.slow)

    return [slow(one) for one in share_of(members)]


def sampled(members: Iterable[Any], kept: int) -> list[Any]:
    """The first `kept` of them for every run of the tests, and a share of the rest, slow."""
    found = [*members]
    return [*found[:kept], *slow_share_of(found[kept:])]


def spread(members: Iterable[Any], step: int) -> list[Any]:
    """Every `step`-th of them, then those beside these, and so on: the first of all kinds."""
    found = [*members]
    return [one for first in range(step) for one in found[first::step]]


def share_below(folder: Path) -> None:
    """Name the folder that all processes of this session have in common."""
    _session[:] = [folder]


def home() -> Path:
    """The folder of all that is shared."""
    return _session[0]


def fmu_store(*flavours: str) -> Path:
    """The shared FMUs of the catalogue: FLAVOUR/NAME.fmu, what `--fmus` takes.

    The flavours named are there and native, the default of every command, each built once per
    session; native ones also of the designs that built-in scenarios name.
    """
    from cosim.fmu import build_fmu  # noqa: PLC0415 - most tests need no FMU
    from cosim.fmu.export import CATALOGUE  # noqa: PLC0415 - most tests need no FMU

    def build(folder: Path, flavour: str) -> None:
        for spec in CATALOGUE.values():
            build_fmu(spec, folder, flavour)
        if flavour == "native":
            _build_of_designs(folder.parent)

    for flavour in dict.fromkeys(("native", *flavours)):
        made_once(f"fmus/{flavour}", lambda folder, flavour=flavour: build(folder, flavour))
    return home() / "fmus"


def _build_of_designs(root: Path) -> None:
    from cosim.scenario import FmuCache, builtin_names, load  # noqa: PLC0415 - most tests need no FMU

    parts = (part.fmu for n in builtin_names() for part in load(n).scenario.components.values())
    for fmu in {fmu for fmu in parts if ":" in fmu}:
        FmuCache(root, root).find(fmu)


def fmu_folder(flavour: str) -> Path:
    """The shared FMUs of one flavour: NAME.fmu."""
    return fmu_store(flavour) / flavour


def made_once(name: str, make: Callable[[Path], object]) -> Path:
    """The folder `name` of the session, filled by `make` in whichever process asks first.

    The others wait until it is whole. A `make` that fails leaves nothing, and the next one who
    asks tries again.
    """
    folder, seal = home() / name, _seals() / name.replace("/", _SLASH)
    whole = seal.with_name(seal.name + _WHOLE)
    if not whole.exists():
        seal.parent.mkdir(parents=True, exist_ok=True)
        with lock_file(f"{seal}.lock"):
            if not whole.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir(parents=True)
                make(folder)
                for path in [folder, *folder.rglob("*")]:
                    path.chmod(path.stat().st_mode & _NO_WRITE)
                seal.write_text(json.dumps(_state(folder)), "utf-8")
                seal.rename(whole)
    return folder


def copied(source: Path, target: Path) -> Path:
    """`source`, a file or a folder, again as `target`, which may be written to."""
    if source.is_file():
        return Path(shutil.copyfile(source, target))
    target.mkdir(parents=True, exist_ok=True)
    for path in source.iterdir():
        copied(path, target / path.name)
    return target


def what_was_written() -> list[str]:
    """The shared files that are not as they were made, by name."""
    found = []
    for seal in _seals().glob(f"*{_WHOLE}"):
        folder = home() / seal.stem.replace(_SLASH, "/")
        now, then = _state(folder), json.loads(seal.read_text("utf-8"))
        changed = (name for name in {*then, *now} if then.get(name) != now.get(name))
        found += [str(folder.relative_to(home()) / name) for name in changed]
    return sorted(found)


def _state(folder: Path) -> dict[str, list[int]]:
    """Size, time of the last change and inode of each file."""
    files = {str(p.relative_to(folder)): p.stat() for p in folder.rglob("*") if p.is_file()}
    return {name: [s.st_size, s.st_mtime_ns, s.st_ino] for name, s in files.items()}


def _seals() -> Path:
    """One file per folder, there when it is whole, with the state of its files then."""
    return home() / "seals"
