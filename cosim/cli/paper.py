"""The verb that holds the paper to its word: paper."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.arguments import write
from cosim.cli.common import JsonOption, answer, progress
from cosim.core import InputError
from cosim.trace import pyplot


def paper(
    html: Annotated[
        Path | None,
        typer.Option(help="Write a page here as well, pictures inside (needs the extra plot)."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Reproduce the paper: each equation chain, table and figure, printed and computed.

    Everything is computed now, which takes some twenty seconds. A verdict is a result, whatever
    it is: exit code 0.
    """
    # what this verb alone needs takes half a second to load
    from cosim.paper import page, paper_view, reproduce  # noqa: PLC0415

    if html is not None:
        _check(html)
    with progress() as report_progress:
        report = reproduce(report_progress)
    if html is not None:
        write(html, page(report))
    answer(as_json, report.to_json, lambda: paper_view(report))


def _check(html: Path) -> None:
    """Say before anything takes time what would fail at its end."""
    pyplot()
    nearest = next(folder for folder in html.absolute().parents if folder.exists())
    if html.is_dir() or not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            "the page cannot be written there",
            where=str(html),
            expected="the name of a file, in a folder that can be written",
        )
