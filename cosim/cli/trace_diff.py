"""The command that compares two traces: trace diff."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.common import (
    JsonOption,
    answer,
    output_file,
    progress,
)
from cosim.cli.terminal import typed
from cosim.cli.trace_view import diff_view
from cosim.core import CheckFailedError, InputError
from cosim.trace import Tolerances, diff as compare
from cosim.trace.comparison import Tolerance, diff_json, diff_verdict, draw_diff


def diff(
    a: Annotated[Path, typer.Argument(metavar="A", help="The first trace.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The second trace.")],
    absolute: Annotated[
        float,
        typer.Option("--abs", help="Largest difference allowed, in the unit of the signal."),
    ] = 0.0,
    relative: Annotated[
        float,
        typer.Option("--rel", help="Largest difference allowed, relative to the larger value."),
    ] = 0.0,
    signal: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            metavar="NAME=ABS[,REL]",
            help="Tolerances of one signal or one group (plant.eta); may be repeated.",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Draw the signals that differ most to this .png, .svg or .pdf file.",
            callback=output_file,
        ),
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    """Compare two traces: which signal differs first, when, and by how much.

    Values agree if they differ by at most ABS, or by at most REL times the larger value; without
    tolerances they must be equal. Signals recorded at different instants are compared with
    sample and hold. Links, scenario, design and result are also compared, but only the messages of
    links affect the exit code.

    Exit code 0: equal within the tolerances; 1: different; 2: bad input.

    \b
    cosim trace diff traces/auv-survey.mcap again.mcap
    cosim trace diff traces/auv-survey.mcap again.mcap --rel 1e-9 --signal plant.eta=1e-6
    cosim trace diff traces/auv-survey.mcap traces/auv-survey-naive.mcap --picture diff.png
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
        line=diff_verdict(found) + (f": {b} has every message of {a}" if found.identical else ""),
        tone="good" if found.equal else "bad",
        then=() if found.identical else (typed("trace report", a, "--compare", b),),
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
        raise InputError(
            "the name of the signal is missing", where="--signal", expected="NAME=ABS", got=text
        )
    return name, Tolerance(*tolerance)
