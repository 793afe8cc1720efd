"""The command that reproduces the paper: paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim import core
from cosim.cli.arguments import write
from cosim.cli.common import (
    JsonOption,
    answer,
    output_file,
    progress,
)


def paper(
    html: Annotated[
        Path | None,
        typer.Option(
            help="Also write the report as one HTML page with pictures (needs the extra plot).",
            callback=output_file,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute each equation chain, table and figure of the paper; compare with the printed one.

    Everything is computed anew, which takes about twenty seconds. The exit code is 0, whatever
    the verdicts are.

    \b
    cosim paper
    cosim paper --html paper.html
    """
    # only this command needs these modules, and they take half a second to load
    from cosim.paper import page, paper_view, reproduce  # noqa: PLC0415

    if html is not None:
        core.pyplot()  # before the long computation begins
    with progress() as report_progress:
        report = reproduce(report_progress)
    if html is not None:
        write(html, page(report))
    counts = ", ".join(f"{verdict} {count}" for verdict, count in report.counts.items() if count)
    answer(
        as_json,
        report.to_json,
        lambda: paper_view(report),
        line=f"{len(report.rows)} claims of the paper computed anew: {counts}",
        then=("cosim paper --html paper.html",) if html is None else (),
    )
