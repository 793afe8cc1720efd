"""The command that repeats a run from its trace: trace rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim import replay
from cosim.cli.common import (
    FMUS,
    FmusOption,
    JsonOption,
    answer,
    output_trace,
    progress,
)
from cosim.cli.replay_view import rerun_line, rerun_view
from cosim.cli.runs import make_fmu_cache
from cosim.core import CheckFailedError


def rerun(
    file: Annotated[Path, typer.Argument(help="A trace written by cosim run.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="File in which to keep the new trace.", callback=output_trace
        ),
    ] = None,
    fmus: FmusOption = FMUS,
    as_json: JsonOption = False,
) -> None:
    """Repeat a run from its trace alone and compare the two (exit code 1 if they differ).

    \b
    cosim trace rerun traces/auv-survey.mcap
    cosim trace rerun traces/auv-survey.mcap --out again.mcap
    """
    with progress() as report_progress:
        result = replay.rerun(file, make_fmu_cache(fmus), output=out, progress=report_progress)
    answer(
        as_json,
        result.to_json,
        lambda: rerun_view(result),
        line=rerun_line(result),
        tone="good" if result.identical else "bad",
    )
    if not result.identical:
        raise typer.Exit(CheckFailedError.exit_code)
