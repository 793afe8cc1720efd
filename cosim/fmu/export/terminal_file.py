"""Write terminalsAndIcons.xml: the variables of an FMU in the groups in which they are connected.

Of FMI 3.0, section 2.4.9; FMI 2.0.4 takes the same file in the same place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from cosim.fmu.export.model_description import as_bytes
from cosim.fmu.export.spec import ComponentSpec

_NAMED = {"eta": "pose", "nu": "twist", "force": "wrench", "moment": "wrench"}
"""Group of variables -> terminal, where its name is not that of the group."""
_TEXT = {
    "pose": "position and heading in the earth frame",
    "twist": "linear and angular speeds in the body frame",
    "wrench": "forces and moments in the body frame",
}
_ELEMENT = re.compile(r"(?P<group>.*)\[(?P<index>\d+(?:,\d+)*)\]")
_MEMBER = re.compile(r"(?P<group>.+)\.(?P<member>[^.]+)")


def terminal_files(spec: ComponentSpec) -> dict[str, bytes]:
    """Return the file by its path in the archive; none without a group of inputs or outputs.

    A group `eta.x`, `eta.y` is a plug, matched by the names of its members; an array `u[1]`,
    `u[2]` is a sequence, matched by their order.
    """
    groups = _groups(v.name for v in spec.variables if v.causality in ("input", "output"))
    if not groups:
        return {}
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    holder = ET.SubElement(root, "Terminals")
    for (name, rule), members in groups.items():
        if rule == "sequence" and (name, "plug") in groups:
            name = f"{name}[]"  # noqa: PLW2901 - names of terminals are distinct
        terminal = ET.SubElement(holder, "Terminal", name=name, matchingRule=rule)
        if name in _TEXT:
            terminal.set("terminalKind", f"_auvcosim_{name}")
            terminal.set("description", _TEXT[name])
        for variable, member in members:
            row = ET.SubElement(
                terminal, "TerminalMemberVariable", variableName=variable, variableKind="signal"
            )
            if rule == "plug":
                row.set("memberName", member)
    return {"terminalsAndIcons/terminalsAndIcons.xml": as_bytes(root)}


def _groups(names: Iterable[str]) -> dict[tuple[str, str], list[tuple[str, str]]]:
    """Return (terminal, matching rule) -> variables, each with the name of the member."""
    found: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name in names:
        if element := _ELEMENT.fullmatch(name):
            found.setdefault((element["group"], "sequence"), []).append((name, element["index"]))
        elif part := _MEMBER.fullmatch(name):
            group = part["group"]
            terminal = _NAMED.get(group, group)
            # of two groups in one terminal, members of one name must differ: force.z, moment.z
            member = name if terminal == "wrench" else part["member"]
            found.setdefault((terminal, "plug"), []).append((name, member))
    return found
