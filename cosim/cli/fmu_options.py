"""What the verbs that make an FMU share: its name, its flavour, its platforms."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.core import InputError
from cosim.fmu import Flavour, FmuTarget, platforms_named

OutOption = Annotated[
    Path | None, typer.Option("--out", "-o", help="The FMU (default: FILE with .fmu).")
]
NameOption = Annotated[
    str | None, typer.Option("--name", help="Name of the model (default: the FMU's file name).")
]
FlavourOption = Annotated[
    Flavour,
    typer.Option(
        help="native: C for FMI 2.0, which every tool loads; native-fmi3: for FMI 3.0; "
        "python: a pythonfmu slave for Python hosts, which needs no compiler."
    ),
]
PlatformsOption = Annotated[
    str,
    typer.Option(
        help="Binaries of a native FMU: host, by this machine's compiler; all, or names as "
        "x86_64-linux,x86_64-windows, cross-compiled (extra cross). Its sources are inside."
    ),
]


def kind_of(flavour: Flavour, platforms: str) -> FmuTarget:
    """What the options ask for.

    Raises
    ------
    InputError : no such platform, or platforms for an FMU in Python.
    """
    return FmuTarget(flavour, platforms_named(platforms))


def not_onto(source: Path, target: Path) -> None:
    """Refuse to write an FMU over the file that it is made from.

    Raises
    ------
    InputError : they are one file.
    """
    if target.resolve() == source.resolve():
        raise InputError(
            "the FMU would replace what it is made from",
            where=str(source),
            hint="another file: --out",
        )
