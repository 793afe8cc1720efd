"""The group of verbs about FMUs."""

from __future__ import annotations

import typer

fmu_app = typer.Typer(no_args_is_help=True, help="Make FMUs, and look into them.")
