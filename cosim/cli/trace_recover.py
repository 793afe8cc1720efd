"""Verbs about traces that may not be whole: recover, verify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.common import JsonOption, answer, progress
from cosim.cli.recover_view import recovery_view, verification_view
from cosim.core import CheckFailedError, LossError
from cosim.trace import recover as recover_trace, verify as verify_trace


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
    with progress() as report_progress:
        result = recover_trace(file, out, force=force, progress=report_progress)
    answer(as_json, result.to_json, lambda: recovery_view(result))
    if result.lost:
        raise typer.Exit(LossError.exit_code)


def verify(
    file: Annotated[Path, typer.Argument(help="A trace, or any MCAP file.")],
    fmus: Annotated[
        Path | None,
        typer.Option("--fmus", help="Look up the FMUs named, by their SHA-256, in this folder."),
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    """Prove that a trace is whole and unchanged, and that what it records could have happened.

    Structure, checksums, indexes; cosim.run first, cosim.result last, the files that it names;
    every message of a link sent by its sender, at most once delivered, never early, in the
    link's order, and as many as the result says. Of other tools' files the structure alone.

    Exit code 0 when all is right, 1 when a check fails, 3 when the file is right as far as it
    goes, but cut short or without a result.

    cosim trace verify traces/auv-acoustic.mcap

    cosim trace verify traces/auv-acoustic.mcap --fmus fmus --json
    """
    found = verify_trace(file, fmus)
    answer(as_json, found.to_json, lambda: verification_view(found))
    if found.verdict != "ok":
        failed = found.verdict == "failed"
        raise typer.Exit(CheckFailedError.exit_code if failed else LossError.exit_code)
