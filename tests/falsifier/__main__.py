"""Fly the whole matrix, its edges, and cases at random; say every claim that is wrong.

    python -m tests.falsifier [--seed N] [--cases N] [--kind NAME ...] [--jobs N] [--quick]
                              [--json] [--page FILE]

Exit code 1: a run claimed falsely, claimed though a hypothesis was broken, or did not claim where
nothing was.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

if __package__ == "tests.falsifier":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from falsifier.campaign import cells_of, make_all
from falsifier.cells import BROKE, BROKEN, FALSE, GOOD, REFUSED, Case, Cell, drawn, matrix
from falsifier.edges import EDGES, edge_cell
from falsifier.kinds import LOOPS
from falsifier.page import page


def main() -> int:
    """Run the command; 0 if every cell is as it must be."""
    names = [x.name for x in LOOPS]
    parser = argparse.ArgumentParser(prog="python -m tests.falsifier")
    parser.add_argument("--seed", type=int, default=1, help="of the cases at random")
    parser.add_argument("--cases", type=int, default=500, help="how many at random")
    parser.add_argument("--kind", nargs="*", choices=names, default=names)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--quick", action="store_true", help="the share of every run of the tests")
    parser.add_argument("--claims", action="store_true", help="broken loops alone")
    parser.add_argument("--until-wrong", action="store_true", help="end with the first wrong cell")
    parser.add_argument("--known", type=Path, help="wrong cells that are not told")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--page", type=Path, help="write the matrix as Markdown")
    parser.add_argument("--parts", type=Path, help="folder of the FMUs, to keep them")
    asked = parser.parse_args()
    begun = time.perf_counter()
    fixed = matrix(quick=asked.quick, kinds=asked.kind, claims=asked.claims)
    known = set() if asked.known is None else _known_before(asked.known)
    edges: list[Case] = [
        lambda field, edge=edge: edge_cell(field, edge) for edge in EDGES if edge.kind in asked.kind
    ]
    cases = [*fixed, *edges, *drawn(asked.seed, asked.cases, asked.kind)]
    with tempfile.TemporaryDirectory(prefix="falsifier-") as scratch:
        folder = asked.parts or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        stops = (lambda cell: _wrong(cell, known)) if asked.until_wrong else None
        cells = _fly(cases, folder, asked, stops)
    seconds = time.perf_counter() - begun
    at_random = [x for x in cells if x.drawn]
    certain = [x for x in cells if not x.drawn]
    if asked.page is not None:
        asked.page.write_text(page(certain, at_random, asked.seed, _command()), "utf-8")
    wrong = [x for x in cells if _wrong(x, known)]
    if asked.json:
        advance = [x.to_json() for x in wrong]
        print(json.dumps({"cells": len(cells), "seconds": seconds, "wrong": advance}, indent=1))
    else:
        _show(cells, wrong, seconds)
    return int(bool(wrong))


def _command() -> str:
    """The command as it was given, without what depends on the machine."""
    words, given = ["python", "-m", "tests.falsifier"], iter(sys.argv[1:])
    for word in given:
        if word in {"--parts", "--jobs"}:
            next(given, None)
        elif word == "--page":
            words += [word, "docs/explanation/" + Path(next(given)).name]
        else:
            words.append(word)
    return shlex.join(words)


def _wrong(cell: Cell, known: set[tuple[str, ...]]) -> bool:
    return cell.verdict != GOOD and (cell.kind, cell.hypothesis, cell.name) not in known


def _known_before(path: Path) -> set[tuple[str, ...]]:
    return {tuple(x) for x in json.loads(path.read_text("utf-8"))}


def _fly(
    cases: list[Case],
    folder: Path,
    asked: argparse.Namespace,
    stops: Callable[[Cell], bool] | None,
) -> list[Cell]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as progress:
        made = progress.add_task("parts", total=len(LOOPS))
        make_all(folder, asked.kind, lambda: progress.advance(made))
        task = progress.add_task("flights", total=len(cases))
        fmus = folder / "fmus"
        advance = lambda: progress.advance(task)  # noqa: E731 - one word
        return cells_of(cases, folder, fmus, jobs=asked.jobs, advance=advance, stops=stops)


def _show(cells: list[Cell], wrong: list[Cell], seconds: float) -> None:
    console = Console(width=None if sys.stdout.isatty() else 200, highlight=False, markup=False)
    table = Table(title="Not as it must be", title_justify="left")
    for name in ("kind", "hypothesis", "case", "verdict", "said and flown"):
        table.add_column(name, overflow="fold")
    for each in wrong:
        words = re.sub(r"\S*/case-", "case-", each.words)
        table.add_row(each.kind, each.hypothesis, each.name, each.verdict, words)
    if wrong:
        console.print(table)
    numbers = ", ".join(
        f"{sum(x.verdict == verdict for x in cells)} {verdict}"
        for verdict in (FALSE, BROKEN, REFUSED, BROKE)
    )
    console.print(f"{len(cells)} cells in {seconds:.0f} s: {numbers}")


if __name__ == "__main__":
    sys.exit(main())
