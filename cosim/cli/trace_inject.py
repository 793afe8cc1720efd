"""The command that feeds recorded signals into an FMU: trace inject."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from cosim.cli.common import (
    FMUS,
    TRACES,
    FmusOption,
    JsonOption,
    RunFlavour,
    answer,
    output_trace,
    progress,
)
from cosim.cli.replay_view import inject_json, inject_line, inject_tone, inject_view
from cosim.cli.runs import make_fmu_cache
from cosim.cli.terminal import typed
from cosim.core import CheckFailedError, ComponentError, InputError, check_output
from cosim.fmu import FmuDescription
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.network import Jitter, PacketLink, TransportLink
from cosim.replay import InjectionRequest, SignalMapping, inject as run_injection
from cosim.scenario import link_of, load, nanoseconds
from cosim.trace import Tolerances
from cosim.trace.comparison import Tolerance


def inject(
    file: Annotated[
        Path, typer.Argument(help="The trace with the recorded signals, or any MCAP file.")
    ],
    into: Annotated[
        str, typer.Option(help="The FMU to run: FILE.fmu, or the name of a built-in FMU.")
    ],
    signals: Annotated[
        list[str] | None,
        typer.Option(
            "--map", metavar="SIGNAL=INPUT", help="Feed one signal into an input; may be repeated."
        ),
    ] = None,
    groups: Annotated[
        list[str] | None,
        typer.Option(
            "--map-group",
            metavar="GROUP=GROUP",
            help="Feed all members of a group (plant.eta=eta); may be repeated.",
        ),
    ] = None,
    side: Annotated[
        Literal["delivered", "sent"],
        typer.Option(
            "--as",
            help="delivered: use values as and when they were received; sent: as they were sent.",
        ),
    ] = "delivered",
    link: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="With --as sent: send the signals over this link: none; a link of the recorded "
            "scenario; or FILE.toml:NAME for a link of another scenario.",
        ),
    ] = None,
    sample_time: Annotated[
        float | None,
        typer.Option(help="With --as sent: use a new packet link with this sample time in s."),
    ] = None,
    delay: Annotated[
        float | None,
        typer.Option(
            help="Delay of the new link in s; without --sample-time, it is a transport link."
        ),
    ] = None,
    jitter: Annotated[
        float, typer.Option(help="Width of the new link's uniform jitter, in s.")
    ] = 0.0,
    loss: Annotated[
        float, typer.Option(help="Share of messages that the new link loses, 0 to 1.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Seed of the new link's random draws.")] = 1,
    as_component: Annotated[
        str | None,
        typer.Option(
            help="Give the FMU the inputs, parameters and gain of this recorded component."
        ),
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="Set a parameter or start value; may be repeated."
        ),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(help="Communication step in s (default: the recorded instants)."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File of the new trace (default: traces/...).",
            callback=output_trace,
        ),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(help="Compare the outputs with those of this recorded component."),
    ] = None,
    absolute: Annotated[
        float, typer.Option("--abs", help="Absolute tolerance of --compare.")
    ] = 0.0,
    relative: Annotated[
        float, typer.Option("--rel", help="Relative tolerance of --compare.")
    ] = 0.0,
    fmus: FmusOption = FMUS,
    flavour: Annotated[
        RunFlavour, typer.Option(help="Flavour of a built-in FMU: native, native-fmi3, or python.")
    ] = DEFAULT_FLAVOUR,
    *,
    as_json: JsonOption = False,
) -> None:
    """Feed recorded signals into one FMU and record its outputs in a new trace.

    The replay is open loop: the outputs do not act on the recorded signals. Without --map, the FMU
    receives the inputs of the recorded component that has the same inputs. An FMU of the recorded
    run starts with its recorded parameters; any other FMU starts with its own, unless
    --as-component names a recorded component.

    Exit code 0: done; 1: --compare found a difference; 2: bad input; 4: the FMU failed.

    \b
    cosim trace inject traces/auv-acoustic.mcap --into HinfController --compare controller
    cosim trace inject traces/auv-acoustic.mcap --into HinfController --as sent --delay 0.4
    """
    place = make_fmu_cache(fmus, Path.cwd(), flavour)
    request = InjectionRequest(
        signal_mapping=SignalMapping(
            _pairs("--map", signals), _pairs("--map-group", groups), as_component
        ),
        side=side,
        link=_link(link, sample_time, delay, jitter, loss, seed),
        step_ns=None if step is None else _step(step),
        compare=compare,
        tolerances=Tolerances(Tolerance(absolute, relative)),
    )
    if request.link is not None and side == "delivered":
        raise InputError(
            "a link can only be used for signals as they were sent",
            where="--link",
            hint="--as sent",
        )
    target = out or TRACES / f"{file.name.partition('.')[0]}-into-{Path(into).stem}.mcap"
    if target.resolve() == file.resolve():
        raise InputError("the new trace would overwrite the recorded one", where=str(target))
    check_output(target)
    with progress() as report_progress:
        fmu = place.find(into)
        request = replace(request, parameters=_values(fmu, parameters))
        found = run_injection(file, fmu, target, request, progress=report_progress)
    answer(
        as_json,
        lambda: inject_json(found),
        lambda: inject_view(found),
        line=inject_line(found),
        tone=inject_tone(found),
        then=(typed("trace report", found.trace),),
    )
    if found.status == "failed":
        raise typer.Exit(ComponentError.exit_code)
    if found.compared is not None and not found.compared.equal:
        raise typer.Exit(CheckFailedError.exit_code)


def _pairs(option: str, texts: list[str] | None) -> list[tuple[str, str]]:
    pairs = []
    for text in texts or ():
        name, equals, target = text.partition("=")
        if not (name and equals and target):
            raise InputError(
                "not a pair of names", where=option, expected="RECORDED=INPUT", got=text
            )
        pairs.append((name.strip(), target.strip()))
    return pairs


def _values(fmu: FmuDescription, texts: list[str] | None) -> dict[str, Any]:
    """Return values for variables of the FMU, each in the type of its variable."""
    found: dict[str, Any] = {}
    for name, text in _pairs("--set", texts):
        kind = fmu.port(name, where=f"--set, {fmu.path.name}").kind
        number = {"true": "1", "false": "0"}.get(text, text) if kind == "bool" else text
        try:
            found[name] = text if kind == "string" else float(number)
        except ValueError as error:
            raise InputError(
                "not a number", where=f"--set {name}", expected="a number, true or false", got=text
            ) from error
    return found


def _step(step: float) -> int:
    if not 1e-9 <= step <= 1e8:
        raise InputError(
            "not a step", where="--step", expected="seconds from 1e-9 up", got=f"{step}"
        )
    return nanoseconds(step)


def _link(
    named: str | None,
    sample_time: float | None,
    delay: float | None,
    jitter: float,
    loss: float,
    seed: int,
) -> PacketLink | TransportLink | str | None:
    """Return the link that the options describe, or the name of a link of the recorded scenario."""
    described = sample_time is not None or delay is not None or jitter or loss
    if named is not None:
        if described:
            raise InputError(
                "--link names a link, and other options describe a new one",
                where="--link",
                expected="one or the other",
                got=named,
            )
        return None if named == "none" else _named(named)
    if not described:
        return None
    for option, value in (("--delay", delay or 0.0), ("--jitter", jitter)):
        if not 0.0 <= value <= 1e8:
            raise InputError("not a time", where=option, expected="0 s or more", got=f"{value}")
    if sample_time is None:
        if jitter or loss:
            raise InputError(
                "jitter and loss need a packet link", where="--link", hint="--sample-time"
            )
        return TransportLink("new", nanoseconds(delay or 0.0))
    spread = Jitter("uniform", width_ns=nanoseconds(jitter)) if jitter else Jitter()
    if not 1e-9 <= sample_time <= 1e8:
        raise InputError(
            "not a time", where="--sample-time", expected="more than 0 s", got=f"{sample_time}"
        )
    return PacketLink(
        "new",
        nanoseconds(sample_time),
        delay_ns=nanoseconds(delay or 0.0),
        jitter=spread,
        loss=loss,
        seed=seed,
    )


def _named(text: str) -> PacketLink | TransportLink | str:
    file, colon, name = text.rpartition(":")
    if not colon:
        return text
    scenario = load(file).scenario
    if name not in scenario.links:
        raise InputError.unknown("link", name, scenario.links, where=file)
    return link_of(name, scenario.links[name], scenario.run.seed)
