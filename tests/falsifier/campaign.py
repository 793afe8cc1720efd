"""A campaign: many cells, on so many processes, with its progress."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from falsifier.cells import Case, Cell
from falsifier.flight import Field
from falsifier.kinds import LOOPS
from falsifier.parts import make_parts_of

_cases: list[Case] = []
_fields: dict[int, Field] = {}
_folders: list[Path] = []


def make_all(
    folder: Path, kinds: Sequence[str], advance: Callable[[], None] = lambda: None
) -> None:
    """Make the parts of these kinds in a folder, before processes share it."""
    for loop in LOOPS:
        if loop.name in kinds:
            make_parts_of(loop.scenario, folder)
        advance()


def cells_of(
    cases: Sequence[Case],
    folder: Path,
    fmus: Path,
    *,
    jobs: int = 1,
    advance: Callable[[], None] = lambda: None,
    stops: Callable[[Cell], bool] | None = None,
) -> list[Cell]:
    """Fly all cases, in order, until `stops`; those with nothing to break are left out."""
    _cases[:], _folders[:] = cases, [folder, fmus]
    found = []
    for cell in _each(len(cases), jobs):
        advance()
        if cell is not None:
            found.append(cell)
            if stops is not None and stops(cell):
                break
    return found


def _each(count: int, jobs: int) -> Iterator[Cell | None]:
    if jobs < 2:
        yield from map(_cell, range(count))
        return
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        yield from pool.imap(_cell, range(count), chunksize=8)


def _cell(number: int) -> Cell | None:
    folder, fmus = _folders
    mine = os.getpid()
    if mine not in _fields:
        _fields[mine] = Field(folder, fmus, f"case-{mine}")
    return _cases[number](_fields[mine])
