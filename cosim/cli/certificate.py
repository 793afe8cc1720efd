"""Commands for certificates: check."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.common import JsonOption, answer
from cosim.cli.design_view import certificate_view
from cosim.core import CheckFailedError
from cosim.hinf import check_certificate
from cosim.replay import certificate_in

certificate_app = typer.Typer(
    no_args_is_help=True, help="Check the certificate of a design or an analysis."
)


@certificate_app.command()
def check(
    file: Annotated[
        Path,
        typer.Argument(help="A file written by --save, or an FMU or trace with a certificate."),
    ],
    *,
    as_json: JsonOption = False,
) -> None:
    """Prove the claim of a certificate again from the file alone: no solver, no rounding.

    For a controller FMU or a trace, the command also checks that the certificate is about the
    gain in it: the start values of K[i,j], or the gain that the run used.

    Exit code 0: the claim is proved; 1: it is not; 2: there is no certificate.
    """
    found = certificate_in(file)
    checked = check_certificate(found.data)
    if checked.valid and found.mismatch is not None:
        checked = replace(checked, valid=False, reason=found.mismatch)
    answer(
        as_json,
        lambda: {
            "file": str(file),
            "container": found.container,
            "sha256": found.sha256,
            "valid": checked.valid,
            "reason": checked.reason,
            "claim": checked.claim,
        },
        lambda: certificate_view(str(file), checked, found),
    )
    if not checked.valid:
        raise typer.Exit(CheckFailedError.exit_code)
