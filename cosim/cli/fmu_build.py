"""The verb that makes a plant FMU of a system."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.arguments import numbers
from cosim.cli.common import JsonOption, answer
from cosim.cli.design_view import plant_view
from cosim.cli.fmu_options import (
    FlavourOption,
    NameOption,
    OutOption,
    PlatformsOption,
    kind_of,
    not_onto,
)
from cosim.fmu import export_plant


def build(
    system: Annotated[
        str, typer.Argument(metavar="SYSTEM", help="A system file, FILE.toml; or paper, auv.")
    ],
    out: OutOption = None,
    name: NameOption = None,
    flavour: FlavourOption = "native",
    platforms: PlatformsOption = "host",
    initial: Annotated[
        str | None,
        typer.Option(help="Initial state, one number per state, with commas (default: zero)."),
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    r"""Make a plant FMU of any linear system with delays, in the letters of Eq. (7).

    Any dimension, any number of delays. Inputs are u\[j] and w\[k], outputs x\[i] and z\[l];
    every matrix entry and delay is a parameter that starts with the number of the file. With one
    delay: A1\[i,j], H1\[i,j], delay.d; with several: A1, H1, delay.d1, A2, H2, delay.d2, ...

    A delay marked feedback = true lies between plant and controller: it is the link's, and is
    not in the FMU, unless it has an A or H of its own, which is.
    """
    kind = kind_of(flavour, platforms)
    file = Path(system)
    target = file.with_suffix(".fmu") if out is None else out
    not_onto(file, target)
    start = None if initial is None else numbers("--initial", initial)
    packed = export_plant(system, target, kind=kind, name=name, initial=start)
    n, m = packed.system.B.shape
    p, q = packed.system.D1.shape
    answer(
        as_json,
        lambda: {
            "fmu": str(packed.path),
            "model": packed.name,
            "flavour": packed.kind.flavour,
            "sizes": {"x": n, "u": m, "w": q, "z": p},
            "delays": packed.delays,
            "feedback_delay": packed.system.feedback_delay,
            "solver_step": packed.step,
        },
        lambda: plant_view(packed),
    )
