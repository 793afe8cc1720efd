"""Vehicles and their flights, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from cosim.cli.terminal import facts_table, number
from cosim.core import PLANT_NOTE, counted

if TYPE_CHECKING:
    from cosim.vehicle import Finding, Flight, Overview, VehicleKey

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def findings_view(found: Mapping[str, Sequence[Finding]]) -> RenderableType:
    """Show what is wrong with vehicles, or doubtful, the errors first."""
    parts: list[RenderableType] = []
    for name, findings in found.items():
        for level, colour in _COLOURS.items():
            style = f"bold {colour}"
            parts += [
                Text.assemble((f"{level}  ", style), each.error.text())
                for each in findings
                if each.level == level
            ]
        errors = sum(each.level == "error" for each in findings)
        verdict = ("ok", "bold green") if not errors else (counted(errors, "error"), "bold red")
        parts.append(Text.assemble(f"{name}: ", verdict))
    return Group(*parts)


def keys_view(tables: Mapping[str, tuple[str, Mapping[str, VehicleKey]]]) -> RenderableType:
    """Explain every key of a vehicle file."""
    parts: list[RenderableType] = []
    for heading, (purpose, keys) in tables.items():
        parts.append(Text.assemble((heading, "bold"), f"  {purpose}"))
        table = Table(box=None, pad_edge=False, show_header=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column(overflow="fold")
        for name, key in keys.items():
            needed = " (required)" if key.required else ""
            table.add_row(f"{name}{needed}", Text(f"{key.text} {key.value}"))
        parts.append(Padding(table, (0, 0, 1, 2)))
    return Group(*parts)


def overview_view(found: Overview, picture: str | None, *, parameters: bool) -> RenderableType:
    """Show a vehicle in figures."""
    vehicle = found.vehicle
    source = " ".join(vehicle.source.split())
    parts: list[RenderableType] = [
        Text.assemble((vehicle.name, "bold"), f"  {vehicle.description}"),
        Text(f"source: {source}", style="dim"),
        _facts(found),
        _mass(found),
        _actuators(found),
        _sensors(found),
    ]
    if parameters:
        table = _table("parameter", "value", "unit", "what it is")
        for p in vehicle.parameter_table:
            table.add_row(p.name, f"{p.value:.6g}", p.unit or "", Text(p.text))
        parts.append(table)
    if picture is not None:
        parts.append(Text(f"picture: {picture}"))
    return Group(*parts)


def _facts(found: Overview) -> RenderableType:
    vehicle, trim = found.vehicle, found.trim
    facts = facts_table()
    facts.add_row("degrees of freedom", str(vehicle.degrees_of_freedom), vehicle.attitude)
    controlled = ", ".join(vehicle.control.states)
    facts.add_row("controlled", str(len(vehicle.control.states)), controlled)
    if trim is None:
        facts.add_row("trim", "none", Text(found.no_trim or ""))
    else:
        steady = {n: v for n, v in trim.state.items() if abs(v) > 1e-9 and n[:6] != "actual"}
        words = ", ".join(f"{name} = {value:.4g}" for name, value in steady.items())
        facts.add_row("trim", "", words or "at rest, level")
    for label, value, how in (
        ("poles at the trim", ", ".join(map(_pole, found.poles)), "1/s, without control"),
        (
            "envelope",
            ", ".join(f"{n} {b:g}" for n, b in vehicle.envelope.items()),
            "about the trim",
        ),
    ):
        if value:
            facts.add_row(label, "", Text.assemble(value, (f"  {how}", "dim")))
    for name, share in found.drag.items():
        bound = vehicle.envelope[name]
        facts.add_row(f"hold {name} = {bound:g}", f"{100 * share:.0f} %", "of the limits")
    drives = found.power > 0
    words = "the water drives the vehicle" if drives else "drag takes energy at every velocity"
    facts.add_row("energy", f"{found.power:.3g} W" if drives else "falls", words)
    return facts


def _pole(s: complex) -> str:
    return f"{s.real:.3g}" if abs(s.imag) < 1e-9 else f"{s.real:.3g}{s.imag:+.3g}j"


def _mass(found: Overview) -> RenderableType:
    table = _table("mass matrix", *(name[3:] for name in found.velocities))
    for name, row in zip(found.velocities, found.mass.tolist(), strict=True):
        table.add_row(name[3:], *(f"{value:.5g}" if value else "." for value in row))
    return table


def _actuators(found: Overview) -> RenderableType:
    table = _table("actuator", "limit", "at trim", "lag")
    for a in found.vehicle.actuators:
        trim = None if found.trim is None else found.trim.commands[a.command]
        lag = number(a.lag, 3, "s") if a.lag else "at once"
        table.add_row(a.command, f"{a.limit:g} {a.unit}", number(trim, 3, a.unit), lag)
    return table


def _sensors(found: Overview) -> RenderableType:
    table = _table("sensor", "measures", "every", "noise", "oldest", "over")
    for s in found.vehicle.sensors:
        noise = sorted(set(s.noise))
        table.add_row(
            s.name,
            ", ".join(s.measures),
            f"{s.interval:g} s",
            ", ".join(f"{value:g}" for value in noise),
            f"{s.age:g} s",
            s.over,
        )
    return table


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for k, column in enumerate(columns):
        table.add_column(column, style="bold" if k == 0 else "", overflow="fold")
    return table


def flight_view(flight: Flight, summary: RenderableType) -> RenderableType:
    """Show what came of a flight: the summary of its run, and what lies in its folder."""
    neglected = _neglected(flight)
    picture: Any = flight.picture or f"none; {flight.no_picture}"
    files = Text.assemble(
        "picture: ",
        (str(picture), "bold"),
        "\nagain:   ",
        (f"cosim run {flight.folder / 'scenario.toml'}", "bold"),
        "\nproof:   ",
        (f"cosim certificate check {flight.folder / 'design.json'}", "bold"),
    )
    links = [Text(one.line, style="dim") for one in flight.crossings]
    return Group(summary, *links, *neglected, files)


def _neglected(flight: Flight) -> list[RenderableType]:
    note = flight.design.certificate.get(PLANT_NOTE) or {}
    return [Text(f"outside the model: {words}", style="dim") for words in note.get("neglected", ())]
