"""Verbs about certificates: check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim import show
from cosim.errors import CheckFailedError
from cosim.hinf import check_certificate, read_certificate
from cosim.verbs.common import JsonOption, answer

certificate_app = typer.Typer(
    no_args_is_help=True, help="Check what a design or an analysis claims."
)


@certificate_app.command()
def check(
    file: Annotated[Path, typer.Argument(help="What --save of design or analyse wrote.")],
    *,
    as_json: JsonOption = False,
) -> None:
    """Prove a certificate's claim again from the file alone: no solver, no rounding.

    Exit code 0 if the claim is proved, 1 if it is not, 2 if the file is no certificate.
    """
    checked = check_certificate(read_certificate(file))
    answer(
        as_json,
        lambda: {
            "file": str(file),
            "valid": checked.valid,
            "reason": checked.reason,
            "claim": checked.claim,
        },
        lambda: show.certificate_view(str(file), checked),
    )
    if not checked.valid:
        raise typer.Exit(CheckFailedError.exit_code)
