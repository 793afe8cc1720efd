"""The verb that feeds recorded signals into an FMU."""

from __future__ import annotations

import enum
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.cli.common import FMUS, TRACES, FmusOption, JsonOption, answer, make_fmu_cache, progress
from cosim.cli.inject_view import inject_json, inject_view
from cosim.cli.run import Flavour
from cosim.core import CheckFailedError, ComponentError, InputError
from cosim.fmu import FmuDescription
from cosim.network import Jitter, PacketLink, TransportLink
from cosim.replay import InjectionRequest, SignalMapping, inject as run_injection
from cosim.scenario import check_writable, link_of, load, nanoseconds
from cosim.trace import Tolerance, Tolerances


class SignalSide(enum.Enum):
    """What --as takes."""

    delivered = "delivered"
    sent = "sent"


def inject(
    file: Annotated[Path, typer.Argument(help="The trace with the signals, or any MCAP file.")],
    into: Annotated[str, typer.Option(help="The FMU: FILE.fmu, or a name of the catalogue.")],
    signals: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="SIGNAL=INPUT", help="One signal; may be repeated."),
    ] = None,
    groups: Annotated[
        list[str] | None,
        typer.Option(
            "--map-group", metavar="GROUP=GROUP", help="All members: plant.eta=eta; repeatable."
        ),
    ] = None,
    side: Annotated[
        SignalSide,
        typer.Option("--as", help="What receivers had, when they had it; or what senders sent."),
    ] = SignalSide.delivered,
    link: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="With --as sent: none; a link of the recorded scenario; or FILE.toml:NAME.",
        ),
    ] = None,
    sample_time: Annotated[
        float | None, typer.Option(help="A new packet link: time between messages in s.")
    ] = None,
    delay: Annotated[float | None, typer.Option(help="A new link: its delay in s.")] = None,
    jitter: Annotated[float, typer.Option(help="And jitter, uniform up to so many s.")] = 0.0,
    loss: Annotated[float, typer.Option(help="And share of messages lost, 0 to 1.")] = 0.0,
    seed: Annotated[int, typer.Option(help="And what its luck depends on.")] = 1,
    as_component: Annotated[
        str | None,
        typer.Option(help="Recorded component whose inputs, parameters and gain the FMU gets."),
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="A parameter or start value."),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(help="Communication step in s (default: the instants that were recorded)."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The new trace (default: traces/...).")
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(help="Compare the outputs with those of this recorded component."),
    ] = None,
    absolute: Annotated[float, typer.Option("--abs", help="Tolerance of the comparison.")] = 0.0,
    relative: Annotated[float, typer.Option("--rel", help="Tolerance of the comparison.")] = 0.0,
    fmus: FmusOption = FMUS,
    flavour: Annotated[
        Flavour, typer.Option(help="Which FMU a name of the catalogue means.")
    ] = Flavour.python,
    *,
    as_json: JsonOption = False,
) -> None:
    r"""Feed recorded signals into one FMU; what it answers goes to a new trace.

    Yesterday's data, another controller: open loop, since what it answers does not act on what
    was recorded. Without --map, inputs get what the recorded component with the same inputs
    got. An FMU that flew in the trace starts as it did there; another one with its own
    parameters, unless --as-component names whose it is to have.

    Exit code 0: done; 1: --compare found a difference; 2: bad input; 4: the FMU failed.

    For example:

      cosim trace inject traces/auv-acoustic.mcap --into HinfController --compare controller

      cosim trace inject traces/auv-acoustic.mcap --into mine.fmu --map-group plant.eta=eta
      --as sent --sample-time 0.15 --delay 0.4 --loss 0.1
    """
    place = make_fmu_cache(fmus, Path.cwd(), flavour.value)
    request = InjectionRequest(
        signal_mapping=SignalMapping(
            _pairs("--map", signals), _pairs("--map-group", groups), as_component
        ),
        side=side.value,
        link=_link(link, sample_time, delay, jitter, loss, seed),
        step_ns=None if step is None else _step(step),
        compare=compare,
        tolerances=Tolerances(Tolerance(absolute, relative)),
    )
    if request.link is not None and side is SignalSide.delivered:
        raise InputError("a new link is for what was sent", where="--link", hint="--as sent")
    target = out or TRACES / f"{file.name.partition('.')[0]}-into-{Path(into).stem}.mcap"
    if target.resolve() == file.resolve():
        raise InputError("the new trace would replace the old one", where=str(target))
    check_writable(target)
    with progress() as report_progress:
        fmu = place.find(into)
        request = replace(request, parameters=_values(fmu, parameters))
        target.parent.mkdir(parents=True, exist_ok=True)
        found = run_injection(file, fmu, target, request, progress=report_progress)
    answer(as_json, lambda: inject_json(found), lambda: inject_view(found))
    if found.status == "failed":
        raise typer.Exit(ComponentError.exit_code)
    if found.compared is not None and not found.compared.equal:
        raise typer.Exit(CheckFailedError.exit_code)


def _pairs(option: str, texts: list[str] | None) -> list[tuple[str, str]]:
    pairs = []
    for text in texts or ():
        name, equals, target = text.partition("=")
        if not (name and equals and target):
            raise InputError("not a pair", where=option, expected="RECORDED=INPUT", got=text)
        pairs.append((name.strip(), target.strip()))
    return pairs


def _values(fmu: FmuDescription, texts: list[str] | None) -> dict[str, Any]:
    """Values as their variables have them."""
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
    """The link that the options describe; a name: one of the recorded scenario."""
    described = sample_time is not None or delay is not None or jitter or loss
    if named is not None:
        if described:
            raise InputError(
                "a link is named and described", where="--link", expected="one of both", got=named
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
                "jitter and loss are those of messages", where="--link", hint="--sample-time"
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
