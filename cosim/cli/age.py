"""The command for how old messages may be: age."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from cosim import core, hinf
from cosim.cli.age_view import age_json, age_line, age_view, draw_ages
from cosim.cli.arguments import gain_from, named_problem, numbers
from cosim.cli.common import (
    JsonOption,
    alternatives_named,
    answer,
    output_file,
    progress,
)
from cosim.cli.design import DelayLimitOption, SystemArgument
from cosim.core import InputError

_PANEL = "What is known of the modem"
_MOST_AGES = 4


def age(
    name: SystemArgument,
    ages: Annotated[
        str | None,
        typer.Option(
            help="Greatest ages to compute, in seconds: 0.5,1,2. Default: around the age "
            "of the system."
        ),
    ] = None,
    gamma: Annotated[float | None, typer.Option(help="A gamma to meet at each age.")] = None,
    gain: Annotated[
        str | None,
        typer.Option(
            help='A gain to keep, as rows: "[[0.6, -0.5]]" (default: the scenario\'s, or a '
            "new one for each age)."
        ),
    ] = None,
    assumption: Annotated[
        str | None,
        typer.Option(
            help="What the table assumes about the age: any (however it varies), sampled "
            "(it grows at rate one between messages) or constant. Default: what the "
            "system says."
        ),
    ] = None,
    bit_rate: Annotated[
        float | None, typer.Option(help="Bit rate [bit/s].", rich_help_panel=_PANEL)
    ] = None,
    packet: Annotated[
        int | None,
        typer.Option(help="Size of a message with its headers [byte].", rich_help_panel=_PANEL),
    ] = None,
    distance: Annotated[
        float,
        typer.Option("--range", help="Greatest distance [m].", rich_help_panel=_PANEL),
    ] = 0.0,
    slot: Annotated[
        float | None,
        typer.Option(
            help="Time from one message to the next [s] (default: as fast as they leave).",
            rich_help_panel=_PANEL,
        ),
    ] = None,
    loss: Annotated[
        float, typer.Option(help="Probability that a message is lost.", rich_help_panel=_PANEL)
    ] = 0.0,
    losses: Annotated[
        int | None,
        typer.Option(
            help="Number of losses in a row to tolerate (default: a number exceeded at "
            "most once an hour).",
            rich_help_panel=_PANEL,
        ),
    ] = None,
    other: Annotated[
        float,
        typer.Option(
            help="Further delay that adds to the age, such as that of the command [s].",
            rich_help_panel=_PANEL,
        ),
    ] = 0.0,
    sound_speed: Annotated[
        float,
        typer.Option(help="Speed of the signal [m/s]; 3e8 for radio.", rich_help_panel=_PANEL),
    ] = hinf.problem.SOUND_SPEED,
    delay_limit: DelayLimitOption = hinf.problem.DELAY_LIMIT,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Also draw the table to this .png, .svg or .pdf file (needs the extra plot).",
            callback=output_file,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute how old the messages of a loop may be, and what each age costs.

    For each greatest age, the table shows a gain designed for it (or the one you give), its
    certified gamma, the exact norm and the delay margin of the nominal loop, and how much control a
    disturbance needs. Above the table are the limits of one gain: for any age, a sampled age and a
    constant age (all certified), and the constant age at which the nominal loop loses stability.

    With --bit-rate and --packet, the age to design for is computed from the data of a modem, and
    the arithmetic is shown.

    \b
    cosim age my-system.toml --ages 0.1,0.3
    cosim age auv --bit-rate 5000 --packet 64 --range 600 --slot 0.5 --loss 0.05
    """
    if picture is not None:
        core.pyplot()
    named, own_gain = named_problem(name)
    modem = _modem(bit_rate, packet, distance, slot, loss, losses, other, sound_speed)
    chosen: Any = assumption or (None if modem is None else "sampled")
    if chosen is not None and chosen not in get_args(hinf.synthesis.Assumption):
        raise InputError.unknown(
            "assumption", chosen, get_args(hinf.synthesis.Assumption), where="--assumption"
        )
    least, own_age = 0.0, None
    wanted: Sequence[float] | None = None if ages is None else numbers("--ages", ages)
    if modem is not None:
        least = modem.least if chosen != "constant" else 0.0
        own_age = modem.greatest if chosen != "constant" else modem.least
        wanted = wanted or _ages_of(modem, own_age)
    with progress() as report_progress, alternatives_named("--ages"):
        found = hinf.message_ages(
            named.system,
            named.k1,
            named.k2,
            ages=wanted,
            gain=own_gain if gain is None else gain_from(gain),
            gamma=named.gamma if gamma is None else gamma,
            assumption=chosen,
            least_age=least,
            own_age=own_age,
            limit=delay_limit,
            report_progress=report_progress,
        )
    if picture is not None:
        draw_ages(name, found, picture)
    answer(
        as_json,
        lambda: age_json(name, found, modem, picture),
        lambda: age_view(name, found, modem),
        line=age_line(name, found),
        tone="good" if found.limits[0].age else "open",
    )


def _modem(
    bit_rate: float | None,
    packet: int | None,
    distance: float,
    slot: float | None,
    loss: float,
    losses: int | None,
    other: float,
    sound_speed: float,
) -> hinf.problem.Modem | None:
    """Return the modem that the options describe; None without any of them."""
    if bit_rate is None and packet is None:
        given = {
            "--range": distance,
            "--slot": slot,
            "--loss": loss,
            "--losses": losses,
            "--other": other,
        }
        for option, value in given.items():
            if value:
                raise InputError(
                    "a fact of a modem, but its bit rate and packet size are missing",
                    where=option,
                    expected="--bit-rate and --packet as well",
                )
        return None
    if bit_rate is None or packet is None:
        raise InputError(
            "the time that a message takes to leave needs both",
            where="--bit-rate" if bit_rate is None else "--packet",
            expected="--bit-rate and --packet",
        )
    return hinf.problem.Modem(bit_rate, packet, distance, slot, loss, losses, other, sound_speed)


def _ages_of(modem: hinf.problem.Modem, own: float) -> list[float]:
    """Return the greatest ages after 0, 1, ... losses in a row, a few of them, up to its own."""
    if own == modem.least:
        return [own]
    most = modem.losses_borne
    each = sorted({round(most * i / (_MOST_AGES - 1)) for i in range(_MOST_AGES)})
    return [*(modem.least + (k + 1) * modem.slot for k in each[:-1]), own]
