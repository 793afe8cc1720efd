"""The verb that packs a design as a controller FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.arguments import numbers
from cosim.cli.common import JsonOption, answer
from cosim.cli.design_view import packed_view
from cosim.cli.fmu_options import (
    FlavourOption,
    NameOption,
    OutOption,
    PlatformsOption,
    kind_of,
    not_onto,
)
from cosim.core import InputError
from cosim.fmu import export_controller
from cosim.replay import certificate_in


def controller(
    file: Annotated[
        Path,
        typer.Argument(help="What --save wrote, or a trace or FMU that carries a certificate."),
    ],
    out: OutOption = None,
    name: NameOption = None,
    flavour: FlavourOption = "native",
    platforms: PlatformsOption = "host",
    sample_time: Annotated[
        float | None,
        typer.Option(help="Sampling period in seconds; 0: at every communication point."),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option(
            help="Largest commands: thrust,moment of the vehicle in N, N m; else one each."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Pack a saved design as a controller FMU: gain, limits, certificate and page baked in.

    The proof is checked before anything is written. A design for the vehicle gives a
    controller from position and speed to thrust, as HinfController; any other one from the
    state x to the control u. Gain, limits and sample time stay parameters; the certificate is
    about the gain as packed.
    """
    kind = kind_of(flavour, platforms)
    found = certificate_in(file)
    if found.mismatch is not None:
        raise InputError(
            "the certificate is not about what carries it", where=str(file), got=found.mismatch
        )
    bounds = None if limits is None else numbers("--limits", limits)
    target = file.with_suffix(".fmu") if out is None else out
    not_onto(file, target)
    packed = export_controller(
        found.data,
        target,
        where=str(file),
        kind=kind,
        name=name,
        sample_time=sample_time,
        limits=bounds,
    )
    answer(
        as_json,
        lambda: {
            "fmu": str(packed.path),
            "model": packed.name,
            "flavour": packed.kind.flavour,
            "form": packed.form,
            "K": packed.K,
            "claim": packed.claim,
            "certificate_sha256": packed.sha256,
        },
        lambda: packed_view(packed),
    )
