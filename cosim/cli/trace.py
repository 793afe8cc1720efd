"""Verbs about traces: info, rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.common import FMUS, FmusOption, JsonOption, answer, make_fmu_cache, progress
from cosim.cli.run_view import rerun_view
from cosim.core import CheckFailedError
from cosim.replay import rerun as run_again
from cosim.trace import describe, render

trace_app = typer.Typer(no_args_is_help=True, help="Look into a trace, or run it again.")


@trace_app.command()
def info(
    file: Annotated[Path, typer.Argument(help="A trace, finished or .partial, or any MCAP file.")],
    *,
    as_json: JsonOption = False,
) -> None:
    """Say what a trace holds: run, topics, links, result, content hash."""
    description = describe(file)
    answer(as_json, lambda: description, lambda: render(description))


@trace_app.command()
def rerun(
    file: Annotated[Path, typer.Argument(help="A trace written by cosim run.")],
    out: Annotated[Path | None, typer.Option(help="Keep the new trace here.")] = None,
    fmus: FmusOption = FMUS,
    as_json: JsonOption = False,
) -> None:
    """Rebuild the run from the trace alone, fly it again, and compare (exit 1 if it differs)."""
    with progress() as report_progress:
        result = run_again(file, make_fmu_cache(fmus), output=out, progress=report_progress)
    answer(as_json, result.to_json, lambda: rerun_view(result))
    if not result.identical:
        raise typer.Exit(CheckFailedError.exit_code)
