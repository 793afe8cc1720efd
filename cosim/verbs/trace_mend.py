"""Verbs about traces that may not be whole: recover, verify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.errors import LossError
from cosim.trace import recover as mend
from cosim.verbs.common import JsonOption, answer, progress
from cosim.verbs.mend_view import recovery_view


def recover(
    file: Annotated[
        Path, typer.Argument(help="A .partial, or any MCAP file that is cut short or damaged.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The new file (default: NAME.recovered.mcap beside it)."),
    ] = None,
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace an output that exists.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a finished file of what a crash has left, and say what was lost.

    Every message, metadata record and attachment that is whole is kept; a chunk whose checksum
    does not match is left out. The original stays as it is. Exit code 0 when nothing was lost,
    3 when something was, or may have been: a file without its end does not say what was to come.

    cosim trace recover traces/auv-acoustic.mcap.partial

    cosim trace recover damaged.mcap -o mended.mcap --json
    """
    with progress() as tell:
        result = mend(file, out, force=force, progress=tell)
    answer(as_json, result.to_json, lambda: recovery_view(result))
    if result.lost:
        raise typer.Exit(LossError.exit_code)
