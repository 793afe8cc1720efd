"""Convert connections of an archive to those of a scenario; our link FMUs become links."""

from __future__ import annotations

import re
from collections.abc import Mapping

from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.flatten import End, FlatSystem, FlatWire, Path as Place, end_text, followed
from cosim.scenario.ssp.names import SSD
from cosim.scenario.ssp.tree import Description

_STATES = ("age", "sequence", "dropped")
_LANE = re.compile(r"([uy])\[([1-9][0-9]*)\]")


def connections_of(
    archive: Archive,
    flat: FlatSystem,
    channels: Mapping[Place, tuple[str, str] | None],
    names: Mapping[Place, str],
    fmus: Mapping[Place, FmuDescription],
    description: Description,
) -> list[dict[str, str | float]]:
    """Return the rows of [[connections]].

    Parameters
    ----------
    channels : link FMUs, with name and TOML of their links.
    names : of the other components in the scenario.

    Raises
    ------
    InputError : an end that the FMU does not have, units that need conversion, an unknown link.
    """
    into = {wire.target: wire for wire in flat.wires if wire.target[0] in channels}
    found = []
    for wire in flat.wires:
        if wire.target[0] in channels:
            continue
        if wire.link is not None and wire.link not in description.links:
            what = "a connection over a link that is not described"
            raise archive.wrong(what, f"{SSD}:{wire.line}", got=wire.link)
        source, link, linear = _over(archive, wire, channels, into)
        name = link if source[0] in channels else names[source[0]]
        if source[0] not in channels:
            _check(archive, wire, source, fmus)
        row: dict[str, str | float] = {
            "from": f"{name}.{source[1]}",
            "to": f"{names[wire.target[0]]}.{wire.target[1]}",
        }
        if link is not None and source[0] not in channels:
            row["link"] = link
        if linear[0] != 1.0:
            row["gain"] = linear[0]
        if linear[1] != 0.0:
            row["offset"] = linear[1]
        found.append(row)
    return found


def _over(
    archive: Archive,
    wire: FlatWire,
    channels: Mapping[Place, tuple[str, str] | None],
    into: Mapping[End, FlatWire],
) -> tuple[End, str | None, tuple[float, float]]:
    """Return source, link, factor and offset of a wire; behind a link FMU, the source before it."""
    if wire.source[0] not in channels:
        return wire.source, wire.link, wire.linear
    channel = channels[wire.source[0]]
    link = "" if channel is None else channel[0]
    if wire.source[1] in _STATES:
        return wire.source, link, wire.linear
    lane = _LANE.fullmatch(wire.source[1])
    before = into.get((wire.source[0], f"u[{lane[2]}]")) if lane and lane[1] == "y" else None
    if before is None or before.source[0] in channels:
        what = "a link FMU whose output has no input"
        raise archive.wrong(what, f"{SSD}:{wire.line}", got=end_text(wire.source))
    return before.source, link, followed(before.linear, wire.linear)


def _check(
    archive: Archive, wire: FlatWire, source: End, fmus: Mapping[Place, FmuDescription]
) -> None:
    """Check that both ends exist and that no value needs conversion."""
    ports = []
    for (place, variable), causality in ((source, "output"), (wire.target, "input")):
        port = fmus[place].ports.get(variable)
        if port is None or port.causality != causality:
            known = [p.name for p in fmus[place].ports.values() if p.causality == causality]
            raise InputError.unknown(
                causality,
                variable,
                known,
                where=f"{archive.path}: {SSD}:{wire.line}: component {'.'.join(place)!r}",
            )
        ports.append(port)
    one, other = (
        None if port.unit is None else fmus[place].units.get(port.unit)
        for port, (place, _) in zip(ports, (source, wire.target), strict=True)
    )
    text = f"{end_text(source)} [{ports[0].unit}] -> {end_text(wire.target)} [{ports[1].unit}]"
    if not wire.converts or one is None or other is None or one == other:
        return
    if one.exponents != other.exponents:
        archive.notes.append(f"{text}: the units measure different things")
        return
    raise archive.wrong(
        "a connection that converts units is not supported",
        f"{SSD}:{wire.line}",
        got=text,
        hint="put an FMU that converts between the two; or set suppressUnitConversion",
    )
