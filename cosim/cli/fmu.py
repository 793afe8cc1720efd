"""Verbs about FMUs: info, check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.common import JsonOption, answer
from cosim.cli.fmu_view import check_view, info_view
from cosim.core import CheckFailedError, InputError
from cosim.fmu import fmu_facts, inspect_fmu, run_findings

fmu_app = typer.Typer(
    no_args_is_help=True,
    help="Make an FMU of your plant or controller; look into any FMU, or check it.",
)

FileArgument = Annotated[Path, typer.Argument(help="Any FMU: FMI 1.0, 2.0 or 3.0.")]


@fmu_app.command()
def info(file: FileArgument, *, as_json: JsonOption = False) -> None:
    """Say what an FMU is: kinds of use, platforms, variables, units, what it needs.

    Nothing is unpacked and nothing of it is run.
    """
    found = inspect_fmu(file)
    if found.model is None:
        first = found.findings[0]
        raise InputError(
            "its description cannot be read",
            where=str(file),
            got=f"{first.where}: {first.what}",
            hint=f"cosim fmu check {file}",
        )
    answer(as_json, lambda: fmu_facts(found), lambda: info_view(fmu_facts(found)))


@fmu_app.command()
def check(
    file: FileArgument,
    *,
    run: Annotated[
        bool, typer.Option("--run", help="Load its binary too, in a process of its own.")
    ] = False,
    time: Annotated[
        float,
        typer.Option(
            min=0.1, max=3600.0, help="Time allowed for --run, per kind of use, in seconds."
        ),
    ] = 30.0,
    as_json: JsonOption = False,
) -> None:
    """Find what is wrong with an FMU: archive, schema, variables, units, dependencies, binaries.

    Each finding is an error, a warning or a note, and says why it matters. Only with --run
    is the binary loaded: it is set up, stepped with its own start values, saved, restored,
    reset and ended, in a process of its own, so that a crash is a finding too.

    Exit code 0 if there is no error, 1 if there is one, 2 if the file is no FMU.
    """
    found = inspect_fmu(file)
    if run:
        found = found.with_findings(run_findings(found, time))
    answer(
        as_json,
        lambda: {
            "file": str(file),
            "valid": found.valid,
            "run": run,
            "findings": [each.to_json() for each in found.findings],
        },
        lambda: check_view(str(file), found),
    )
    if not found.valid:
        raise typer.Exit(CheckFailedError.exit_code)
