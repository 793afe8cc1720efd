"""Commands for vehicles: list, new, check, show, fly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim import recordings, vehicle as vehicles
from cosim.cli.arguments import number_or_text, write
from cosim.cli.common import (
    FMUS,
    DetailsOption,
    FmusOption,
    JsonOption,
    answer,
    output_file,
    output_folder,
    progress,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.log_options import with_log_options
from cosim.cli.run_view import outcome_view
from cosim.cli.runs import exit_with, interruptions_reported, make_fmu_cache
from cosim.cli.terminal import console, titles_table, typed
from cosim.cli.vehicle_view import (
    findings_line,
    findings_view,
    flight_view,
    keys_view,
    overview_view,
)
from cosim.core import InputError, counted, seconds, unreadable
from cosim.network import LogFormat
from cosim.trace.outcome import answer_of

vehicle_app = HelpTyper(
    help="Create, check, show and fly a vehicle from its parameters: design, proof and simulation.",
)

VehicleArgument = Annotated[
    str,
    typer.Argument(
        metavar="VEHICLE",
        help="Name of a vehicle of the gallery, or FILE.toml.",
        autocompletion=lambda incomplete: [
            n for n in vehicles.VEHICLES if n.startswith(incomplete)
        ],
    ),
]


@vehicle_app.command("list")
def list_vehicles(*, as_json: JsonOption = False) -> None:
    """List the vehicles of the gallery.

    \b
    cosim vehicle list
    """
    found = [vehicles.load_vehicle(name) for name in vehicles.VEHICLES]
    rows = [
        {"name": v.name, "title": v.description, "source": " ".join(v.source.split())}
        for v in found
    ]
    answer(
        as_json,
        lambda: {"vehicles": rows},
        lambda: titles_table("vehicle", "what it is", rows),
        line=f"{len(rows)} vehicles are in the gallery",
        then=(typed("vehicle fly", rows[0]["name"]), "cosim vehicle new my-vehicle"),
    )


@vehicle_app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the vehicle; the file is NAME.toml.")],
    like: Annotated[
        str, typer.Option("--like", help="Vehicle of the gallery to copy.")
    ] = "bluerov2-heavy",
    as_json: JsonOption = False,
) -> None:
    """Write a new vehicle file, a copy of one of the gallery with a comment for every key.

    \b
    cosim vehicle new my-vehicle
    cosim vehicle new my-remus --like remus100
    """
    stem = name.removesuffix(".toml")
    path = Path(f"{stem}.toml")
    text = vehicles.vehicle_template(path.stem, like)
    if path.exists():
        raise InputError("this file already exists", where=str(path), hint="use another name")
    write(path, text)
    answer(
        as_json,
        lambda: {"file": str(path), "like": like},
        line=f"written: {path}, a copy of {like} with a comment for every key",
        tone="good",
        then=(typed("vehicle check", path), typed("vehicle fly", path)),
    )


@vehicle_app.command()
def check(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="VEHICLE...", help="Vehicle files, or names of vehicles of the gallery."
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """List everything that is wrong with vehicle files, and what is doubtful about the vehicles.

    The checks cover keys and units, the mass matrix, energy (drag must take it away), the trim and
    stability at it, what the actuators can hold, whether the sensors show every controlled state,
    and whether a linear model can be proved over the envelope. Exit code 0: no error; 2: at least
    one.

    \b
    cosim vehicle check my-vehicle.toml
    """
    found = {name: vehicles.diagnose(_text(name), name) for name in names}
    data = {
        "vehicles": [
            {
                "vehicle": name,
                "ok": not any(each.level == "error" for each in each_found),
                "findings": [each.to_json() for each in each_found],
            }
            for name, each_found in found.items()
        ]
    }
    wrong = any(each.level == "error" for some in found.values() for each in some)
    answer(
        as_json,
        lambda: data,
        (lambda: findings_view(found)) if any(found.values()) else None,
        line=findings_line(found),
        tone="bad" if wrong else "good",
        then=() if wrong else tuple(typed("vehicle fly", name) for name in found),
    )
    if wrong:
        raise typer.Exit(InputError.exit_code)


def _text(name: str) -> str:
    if not name.endswith(".toml"):
        return vehicles.vehicle_text(name)
    try:
        return Path(name).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise unreadable(Path(name), error) from error


@vehicle_app.command()
def show(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="VEHICLE",
            help="Name of a vehicle of the gallery, or FILE.toml.",
            show_default=False,
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Draw actuators, poles and drag to this .png, .svg or .pdf file.",
            callback=output_file,
        ),
    ] = None,
    parameters: Annotated[
        bool, typer.Option("--parameters", help="List every parameter of the plant as well.")
    ] = False,
    source: Annotated[bool, typer.Option("--source", help="Print the file instead.")] = False,
    keys: Annotated[
        bool, typer.Option("--keys", help="Explain every key of a vehicle file instead.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show a vehicle: mass matrix, trim, poles at the trim, drag, actuators, sensors.

    \b
    cosim vehicle show bluerov2-heavy
    cosim vehicle show my-vehicle.toml --picture my-vehicle.png
    cosim vehicle show --keys
    """
    if keys:
        tables = vehicles.vehicle_tables()
        answer(
            as_json,
            lambda: {
                heading: {key: each._asdict() for key, each in table.items()}
                for heading, (_, table) in tables.items()
            },
            lambda: keys_view(tables),
            line=f"a vehicle file has {counted(len(tables), 'table')}; its keys:",
            then=("cosim vehicle new my-vehicle",),
        )
        return
    if name is None:
        raise InputError("no vehicle to show", expected="cosim vehicle show VEHICLE, or --keys")
    if source:
        text = _text(name)
        if as_json:
            print(json.dumps({"vehicle": name, "text": text}))
        else:
            console().print(text, soft_wrap=True)
        return
    found = vehicles.overview(vehicles.load_vehicle(name))
    if picture is not None:
        vehicles.draw_overview(found, picture)
    drawn = None if picture is None else str(picture)
    answer(
        as_json,
        lambda: found.to_json() | {"picture": drawn},
        lambda: overview_view(found, drawn, parameters=parameters),
        line=f"{found.vehicle.name}: {found.vehicle.description}",
        then=(typed("vehicle fly", name),),
    )


@vehicle_app.command()
@with_log_options
def fly(
    name: VehicleArgument,
    link: Annotated[
        str | None,
        typer.Option(
            help="Greatest time that a message over the link takes: '2s', '800 ms' "
            "(default: 2s; with --recording, the greatest delay in it)."
        ),
    ] = None,
    loss: Annotated[
        float | None,
        typer.Option(help="Share of the link's messages that are lost, in runs (default: 0.05)."),
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            help="A log of messages, a trace or another MCAP file: the link delays and "
            "loses its messages as recorded."
        ),
    ] = None,
    node: Annotated[
        str | None, typer.Option("--node", help="The link to use of a recording with several.")
    ] = None,
    losses: Annotated[
        int, typer.Option(help="Number of messages lost in a row that the age designed for allows.")
    ] = vehicles.LOSSES_IN_A_ROW,
    duration: Annotated[str, typer.Option(help="Duration of the flight: '3min', 180.")] = "3min",
    step: Annotated[str, typer.Option(help="Communication step.")] = "50 ms",
    seed: Annotated[int, typer.Option(help="Seed of the sea, the losses and the noise.")] = 2,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for all files of the flight (default: flights/NAME).",
            callback=output_folder,
        ),
    ] = None,
    fmus: FmusOption = FMUS,
    details: DetailsOption = False,
    as_json: JsonOption = False,
    *,
    log_format: LogFormat,
) -> None:
    """Design for a vehicle over a slow link, prove the design, and fly it.

    From one file the command makes a linear model at the trim, with an uncertainty that is proved
    over the envelope; an observer and a gain, certified for the age of each measurement; plant,
    sensors and controller as FMUs; and a scenario that can be changed and run again. The loop is
    closed on board. The set-points, and the controlled states that the file measures over = "link",
    come over the link, late and with losses in runs; the output says what crosses which link, and
    up to which age the proof holds. With --recording, the link repeats what was recorded, at the
    recorded times; the design is for the greatest delay in the recording. The summary says which
    assumptions of the guarantee were not met, with --details all of them; the folder keeps the
    design, the trace and a picture.

    Exit code 0: the flight is done; 2: the vehicle or an option is not valid; 4: a component
    failed; 5: nothing could be certified.

    \b
    cosim vehicle fly bluerov2-heavy --link 2s
    cosim vehicle fly my-vehicle.toml --link 800ms --loss 0.2 --duration 5min --out flight
    cosim vehicle fly bluerov2-heavy --recording modem.log --unit ms
    cosim run flights/bluerov2-heavy/scenario.toml
    """
    given: dict[str, Any] = {
        "losses": losses,
        "duration": seconds(number_or_text(duration), "--duration"),
        "step": seconds(number_or_text(step), "--step"),
        "seed": seed,
    }
    given |= {} if link is None else {"link": seconds(number_or_text(link), "--link")}
    given |= {} if loss is None else {"loss": loss}
    craft = vehicles.load_vehicle(name)
    settings, read = _settings(recording, node, log_format, given)
    folder = out or Path("flights") / craft.name
    lines = console(error=True)
    if read is not None:
        lines.print(f"{recording}: {read.line}")
    with progress() as report_progress, interruptions_reported():
        flight = vehicles.fly(
            craft,
            folder,
            settings,
            fmu_cache=make_fmu_cache(fmus, folder),
            say=lines.print,
            progress=report_progress,
        )
    ended = answer_of(craft.name, flight.outcome)
    answer(
        as_json,
        lambda: flight.to_json() | {"recording": None if read is None else read.to_json()},
        lambda: flight_view(flight, outcome_view(flight.outcome, details=details)),
        line=ended.what,
        tone=ended.tone,
        then=(
            typed("trace report", flight.outcome.trace),
            typed("run", flight.folder / "scenario.toml"),
            typed("certificate check", flight.folder / "design.json"),
        ),
    )
    exit_with(flight.outcome)


def _settings(
    recording: Path | None, node: str | None, log_format: LogFormat, given: dict[str, Any]
) -> tuple[vehicles.FlightSettings, recordings.Plausibility | None]:
    """Return the settings of a flight, and what was read of a recording."""
    if recording is None:
        if node is not None or log_format != LogFormat(hints=log_format.hints):
            raise InputError(
                "there is no log to read",
                where="cosim vehicle fly",
                expected="--recording FILE with options of a log",
                got="these options alone",
            )
        return vehicles.FlightSettings(**given), None
    if "loss" in given:
        raise InputError(
            "the recording says which messages are lost",
            where="--loss",
            expected="--recording or --loss",
            got="both",
        )
    name, read = recordings.one_of(recordings.read_log(recording, log_format), recording, node)
    read.plausibility.ask(recording, name)
    return vehicles.FlightSettings.over(read.recording, **given), read.plausibility
