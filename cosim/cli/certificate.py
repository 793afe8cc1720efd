"""Verbs about certificates: check."""

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
    no_args_is_help=True, help="Check what a design or an analysis claims."
)


@certificate_app.command()
def check(
    file: Annotated[
        Path,
        typer.Argument(help="What --save wrote, or what carries a certificate: an FMU, a trace."),
    ],
    *,
    as_json: JsonOption = False,
) -> None:
    """Prove a certificate's claim again from the file alone: no solver, no rounding.

    Of a controller FMU or a trace the certificate that it carries is proved, and that it is
    about their gain: the start values of K[i,j], or the gain that flew.

    Exit code 0 if the claim is proved, 1 if it is not, 2 if there is no certificate.
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
