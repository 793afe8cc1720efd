"""Vehicles and their flights, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Column
from rich.text import Text

from cosim.cli.terminal import facts, number, table
from cosim.core import PLANT_NOTE, counted

if TYPE_CHECKING:
    from cosim.vehicle import Finding, Flight, Overview, VehicleKey

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def findings_line(found: Mapping[str, Sequence[Finding]]) -> str:
    """Say of each vehicle how many errors it has, or that it has none."""
    counts = {
        name: sum(each.level == "error" for each in findings) for name, findings in found.items()
    }
    return "; ".join(f"{name}: {counted(n, 'error') if n else 'ok'}" for name, n in counts.items())


def findings_view(found: Mapping[str, Sequence[Finding]]) -> RenderableType:
    """Show what is wrong with vehicles, or doubtful, the errors first."""
    parts: list[RenderableType] = []
    for findings in found.values():
        for level, colour in _COLOURS.items():
            style = f"bold {colour}"
            parts += [
                Text.assemble((f"{level}  ", style), each.error.text())
                for each in findings
                if each.level == level
            ]
    return Group(*parts)


def keys_view(tables: Mapping[str, tuple[str, Mapping[str, VehicleKey]]]) -> RenderableType:
    """Explain every key of a vehicle file."""
    parts: list[RenderableType] = []
    for heading, (purpose, keys) in tables.items():
        parts.append(Text.assemble((heading, "bold"), f"  {purpose}"))
        columns = Column(style="bold", no_wrap=True), Column(overflow="fold")
        rows = (
            (f"{name}{' (required)' * key.required}", f"{key.text} {key.value}")
            for name, key in keys.items()
        )
        parts.append(Padding(table(columns, rows), (0, 0, 1, 2)))
    return Group(*parts)


def overview_view(found: Overview, picture: str | None, *, parameters: bool) -> RenderableType:
    """Show a vehicle in figures."""
    vehicle = found.vehicle
    source = " ".join(vehicle.source.split())
    parts: list[RenderableType] = [
        Text(f"source: {source}", style="dim"),
        facts(*_facts(found)),
        _mass(found),
        _actuators(found),
        _sensors(found),
    ]
    if parameters:
        rows = ((p.name, f"{p.value:.6g}", p.unit or "", p.text) for p in vehicle.parameter_table)
        parts.append(table("*parameter|value|unit|what it is", rows))
    if picture is not None:
        parts.append(Text(f"picture: {picture}"))
    return Group(*parts)


def _facts(found: Overview) -> Iterator[tuple[str, str, str | Text]]:
    vehicle, trim = found.vehicle, found.trim
    yield "degrees of freedom", str(vehicle.degrees_of_freedom), vehicle.attitude
    controlled = ", ".join(vehicle.control.states)
    yield "controlled", str(len(vehicle.control.states)), controlled
    if trim is None:
        yield "trim", "none", found.no_trim or ""
    else:
        steady = {n: v for n, v in trim.state.items() if abs(v) > 1e-9 and n[:6] != "actual"}
        words = ", ".join(f"{name} = {value:.4g}" for name, value in steady.items())
        yield "trim", "", words or "at rest, level"
    for label, value, how in (
        ("poles at the trim", ", ".join(map(_pole, found.poles)), "1/s, without control"),
        (
            "envelope",
            ", ".join(f"{n} {b:g}" for n, b in vehicle.envelope.items()),
            "about the trim",
        ),
    ):
        if value:
            yield label, "", Text.assemble(value, (f"  {how}", "dim"))
    for name, share in found.drag.items():
        bound = vehicle.envelope[name]
        yield f"hold {name} = {bound:g}", f"{100 * share:.0f} %", "of the limits"
    drives = found.power > 0
    words = "the water drives the vehicle" if drives else "drag takes energy at every velocity"
    yield "energy", f"{found.power:.3g} W" if drives else "falls", words


def _pole(s: complex) -> str:
    return f"{s.real:.3g}" if abs(s.imag) < 1e-9 else f"{s.real:.3g}{s.imag:+.3g}j"


def _mass(found: Overview) -> RenderableType:
    names = [name[3:] for name in found.velocities]
    rows = (
        (name, *(f"{value:.5g}" if value else "." for value in row))
        for name, row in zip(names, found.mass.tolist(), strict=True)
    )
    return table(("*mass matrix", *names), rows)


def _actuators(found: Overview) -> RenderableType:
    trim = {} if found.trim is None else found.trim.commands
    rows = (
        (
            a.command,
            f"{a.limit:g} {a.unit}",
            number(trim.get(a.command), 3, a.unit),
            number(a.lag, 3, "s") if a.lag else "at once",
        )
        for a in found.vehicle.actuators
    )
    return table("*actuator|limit|at trim|lag", rows)


def _sensors(found: Overview) -> RenderableType:
    rows = (
        (
            s.name,
            ", ".join(s.measures),
            f"{s.interval:g} s",
            ", ".join(f"{value:g}" for value in sorted(set(s.noise))),
            f"{s.age:g} s",
            s.over,
        )
        for s in found.vehicle.sensors
    )
    return table("*sensor|measures|every|noise|oldest|over", rows)


def flight_view(flight: Flight, summary: RenderableType) -> RenderableType:
    """Show what came of a flight: the summary of its run, and what lies in its folder."""
    neglected = _neglected(flight)
    picture: Any = flight.picture or f"none; {flight.no_picture}"
    files = Text.assemble(
        "picture: ",
        (str(picture), "bold"),
    )
    links = [Text(one.line, style="dim") for one in flight.crossings]
    return Group(summary, *links, *neglected, files)


def _neglected(flight: Flight) -> list[RenderableType]:
    note = flight.design.certificate.get(PLANT_NOTE) or {}
    return [Text(f"outside the model: {words}", style="dim") for words in note.get("neglected", ())]
