"""Verbs about a gain and what it guarantees: design, analyse."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.arguments import gain_from, named_problem, numbers, with_weights, write
from cosim.cli.common import JsonOption, answer, progress
from cosim.cli.design_answers import analysis_json, design_json
from cosim.cli.design_view import analysis_view, design_view
from cosim.core import InputError, NotAchievableError
from cosim.hinf import (
    DELAY_LIMIT,
    CertifiedDelay,
    GreatestDelay,
    analyse as make_analysis,
    certified_delay,
    design as make_design,
    design_to_json,
    greatest_delay,
    nominal_gamma,
    with_delays,
)
from cosim.models import DelaySystem

SystemArgument = Annotated[
    str, typer.Argument(help="paper, auv, a scenario's name, or a system FILE.toml.")
]
DelaysOption = Annotated[
    str | None,
    typer.Option(help="Delays in seconds, instead of the system's own, as in 0.5,1.25."),
]
DelayLimitOption = Annotated[
    float, typer.Option(help="Where the search for a greatest delay ends, in seconds.")
]


def design(
    name: SystemArgument,
    k1: Annotated[
        str | None, typer.Option(help="Free scalars k1, one per delay, as in -0.3,-1.0.")
    ] = None,
    k2: Annotated[str | None, typer.Option(help="Free scalars k2, one per delay.")] = None,
    gamma: Annotated[
        float | None, typer.Option(help="A bound to meet, instead of the least one.")
    ] = None,
    search: Annotated[
        bool, typer.Option("--search", help="Look for better k1, k2, from these among others.")
    ] = False,
    order: Annotated[
        int | None,
        typer.Option(
            help="0 and up: Bessel-Legendre, sharper than Theorem 2, from whose gain it starts; "
            "from 1 on proved at exactly these delays, or up to them at the same gamma."
        ),
    ] = None,
    delays: DelaysOption = None,
    max_delay: Annotated[
        bool,
        typer.Option(
            "--max-delay",
            help="The greatest delay for the given gamma: of the feedback, or else the first.",
        ),
    ] = False,
    delay_limit: DelayLimitOption = DELAY_LIMIT,
    price: Annotated[
        bool,
        typer.Option(
            "--uncertainty-price",
            help="Certify the same gain without uncertainty as well: what gamma pays for it.",
        ),
    ] = False,
    decay: Annotated[
        float | None,
        typer.Option(help="Rate [1/s] at which every solution is to decay at least, with w = 0."),
    ] = None,
    gain_limit: Annotated[
        float | None, typer.Option(help="Bound on |K|, its largest singular value.")
    ] = None,
    peak_control: Annotated[
        str | None,
        typer.Option(
            help="Bound on every |u_i(t)|, one number or one per input, from --offset and --energy."
        ),
    ] = None,
    offset: Annotated[
        str | None,
        typer.Option(
            help="Where a flight may start: bounds on |x_i(0)|, one per state, held before."
        ),
    ] = None,
    energy: Annotated[
        float | None, typer.Option(help="Bound on the square root of the integral of w'w.")
    ] = None,
    weights: Annotated[
        str | None, typer.Option(help="Weights of the rows of z, in place of the system's own.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write the design with its exact certificate here (JSON).")
    ] = None,
    save_refutation: Annotated[
        Path | None,
        typer.Option(help="Write the exact proof of what cannot be had here (JSON), if one is."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Design the H-infinity gain of a system with delays, and prove it exactly.

    gamma bounds the gain from w to z for every admissible uncertainty and is certified in
    rational arithmetic for the gain as it flies; the exact norm and the abscissa of the
    nominal loop stand beside it. k1 and k2 are free, and worth a search; where neither the
    system nor the command line has them, they are searched. What else is demanded is proved in
    the same way: --decay, --gain-limit, and --peak-control with --offset or --energy. What
    cannot be had ends with exit code 5, and where that is proved exactly, with a proof to save.
    """
    named, gain = named_problem(name)
    if weights is not None:
        named = with_weights(named, numbers("--weights", weights))
    system = named.system
    if delays is not None:
        system = with_delays(system, numbers("--delays", delays))
    scalars = (
        named.k1 if k1 is None else numbers("--k1", k1),
        named.k2 if k2 is None else numbers("--k2", k2),
    )
    asked = {
        "decay": decay,
        "gain_limit": gain_limit,
        "peak_control": None if peak_control is None else numbers("--peak-control", peak_control),
        "offset": None if offset is None else numbers("--offset", offset),
        "energy": energy,
    }
    design_constraints = asdict(named.design_constraints) | {
        k: v for k, v in asked.items() if v is not None
    }
    goal = named.gamma if gamma is None else gamma
    greatest: GreatestDelay | None = None
    with progress() as report_progress, _refutation_saved(save_refutation):
        report_progress(f"design of {name}", 0.0)
        if max_delay:
            if gain is not None:
                raise InputError(
                    "this scenario gives its gain, and a greatest delay is designed for",
                    where="--max-delay",
                )
            if any(value is not None for value in design_constraints.values()):
                raise InputError(
                    "a greatest delay is found for gamma alone",
                    where="--max-delay",
                    expected="no decay, gain limit or peak of the control beside it",
                    hint="--delays, to try them at a delay",
                )
            delay_index = _in_question(system)
            greatest = greatest_delay(
                system,
                goal,
                *scalars,
                delay_index=delay_index,
                limit=delay_limit,
                search=search or None,
                order=order,
            )
            found = greatest.design
        else:
            found = make_design(
                system,
                *scalars,
                gamma=goal,
                gain=gain,
                search=search or None,
                order=order,
                **design_constraints,
            )
        nominal = nominal_gamma(found) if price else None
    if save is not None:
        write(save, json.dumps(design_to_json(found), indent=1, allow_nan=False) + "\n")
    refutation = None if greatest is None else greatest.refutation
    kept = None if refutation is None else save_refutation
    if kept is not None:
        write(kept, json.dumps(refutation, indent=1, allow_nan=False) + "\n")
    answer(
        as_json,
        lambda: design_json(name, found, greatest, save, kept, nominal, named.weights),
        lambda: design_view(name, found, greatest, nominal),
    )


@contextmanager
def _refutation_saved(path: Path | None) -> Iterator[None]:
    """Where something cannot be had, and that is proved: keep the proof, and say so."""
    try:
        yield
    except NotAchievableError as error:
        if error.certificate is not None:
            next_step = "--save-refutation FILE keeps the proof"
            if path is not None:
                write(path, json.dumps(error.certificate, indent=1, allow_nan=False) + "\n")
                next_step = f"cosim certificate check {path}, the proof"
            error.hint = next_step if error.hint is None else f"{error.hint}; {next_step}"
        raise


def _in_question(system: DelaySystem) -> int:
    """Which delay `--max-delay` asks about: that of the feedback, or else the first."""
    return next((j for j, delay in enumerate(system.delays) if delay.feedback), 0)


def analyse(
    name: SystemArgument,
    gain: Annotated[
        str | None,
        typer.Option(
            help='K, row by row, as in "[[0.6, -0.5]]"; else that of the scenario, or none.'
        ),
    ] = None,
    order: Annotated[
        int,
        typer.Option(
            help="0: Theorem 1. N: Bessel-Legendre, sharper; up to these delays, or at them."
        ),
    ] = 0,
    gamma: Annotated[
        float | None, typer.Option(help="A bound to prove, instead of the least one.")
    ] = None,
    delays: DelaysOption = None,
    max_delay: Annotated[
        bool,
        typer.Option(
            "--max-delay",
            help="The greatest delay for stability, or for --gamma: of the feedback, or else the "
            "first.",
        ),
    ] = False,
    delay_limit: DelayLimitOption = DELAY_LIMIT,
    save: Annotated[
        Path | None, typer.Option(help="Write the exact certificate here (JSON), if there is one.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Say what a given gain guarantees, or the system as it is, and prove it exactly.

    gamma is the least one that is certified, for every admissible uncertainty; without w and z
    it is stability. What is not certified may still be true: that is a result, with exit code 0.
    """
    named, own_gain = named_problem(name)
    system = named.system
    if delays is not None:
        system = with_delays(system, numbers("--delays", delays))
    K = own_gain if gain is None else gain_from(gain)
    greatest: CertifiedDelay | None = None
    with progress() as report_progress:
        report_progress(f"analysis of {name}", 0.0)
        if max_delay:
            delay_index = _in_question(system)
            greatest = certified_delay(
                system, K, gamma, delay_index=delay_index, order=order, limit=delay_limit
            )
            found = greatest.analysis
        else:
            found = make_analysis(system, K, gamma, order=order)
    saved = save if found.certified else None
    if saved is not None:
        write(saved, json.dumps(found.certificate, indent=1, allow_nan=False) + "\n")
    answer(
        as_json,
        lambda: analysis_json(name, found, greatest, saved),
        lambda: analysis_view(name, found, greatest),
    )
