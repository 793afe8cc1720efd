"""The verb that compares two traces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.common import JsonOption, answer, progress
from cosim.cli.diff_view import diff_view
from cosim.core import CheckFailedError, InputError
from cosim.trace import Tolerance, Tolerances, diff as compare, diff_json, draw_diff


def diff(
    a: Annotated[Path, typer.Argument(metavar="A", help="A trace.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another.")],
    absolute: Annotated[
        float, typer.Option("--abs", help="Largest difference, in the signal's own unit.")
    ] = 0.0,
    relative: Annotated[
        float, typer.Option("--rel", help="Largest difference, as a share of the larger value.")
    ] = 0.0,
    signal: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            metavar="NAME=ABS[,REL]",
            help="Tolerances of one signal, or of a group (plant.eta); may be repeated.",
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the signals that part most: FILE.png, .svg or .pdf.")
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    r"""Say where two traces part: which signal first, when, and by how much.

    Values agree if they differ by at most ABS, or by at most REL of the larger; without
    tolerances they must be the same. Rows at other instants (another rate) are compared as
    they were held. Links, scenario, design and result are compared too; of these, the messages
    of links count.

    Exit code 0: equal within the tolerances; 1: not; 2: bad input.

    For example:

      cosim trace diff yesterday.mcap today.mcap

      cosim trace diff a.mcap b.mcap --rel 1e-9 --signal plant.eta=1e-6 --picture apart.png
    """
    tolerances = Tolerances(
        Tolerance(absolute, relative), dict(_special(text) for text in signal or ())
    )
    with progress() as report_progress:
        report_progress("comparing", 0.0)
        found = compare(a, b, tolerances)
    drawn = None if picture is None else draw_diff(found, picture)
    answer(
        as_json,
        lambda: diff_json(found) | {"picture": None if drawn is None else str(drawn)},
        lambda: diff_view(found),
    )
    if not found.equal:
        raise typer.Exit(CheckFailedError.exit_code)


def _special(text: str) -> tuple[str, Tolerance]:
    name, _, numbers = text.rpartition("=")
    try:
        absolute, _, relative = numbers.partition(",")
        tolerance = float(absolute), float(relative or 0)
    except ValueError as error:
        raise InputError(
            "not a tolerance", where="--signal", expected="NAME=ABS or NAME=ABS,REL", got=text
        ) from error
    if not name:
        raise InputError("no signal", where="--signal", expected="NAME=ABS", got=text)
    return name, Tolerance(*tolerance)
