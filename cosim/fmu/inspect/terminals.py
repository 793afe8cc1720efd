"""Check terminals and build descriptions of FMI 3 beyond their schemas."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from typing import Any

from cosim.fmu.inspect.declared_model import DeclaredModel
from cosim.fmu.inspect.findings import Finding, finding

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
BUILD = "sources/buildDescription.xml"
_CONNECTED = ("input", "output", "parameter", "calculatedParameter")
_NAMED = ("variableName", "inStreamVariableName", "outStreamVariableName")


def terminal_findings(root: Any, model: DeclaredModel, names: Collection[str]) -> Iterator[Finding]:
    """Check terminals: their names, members and pictures.

    Parameters
    ----------
    root : of terminalsAndIcons.xml.
    names : of the files of the FMU.
    """
    if root.get("fmiVersion") != model.version and model.major == 3:
        what = f"fmiVersion is {root.get('fmiVersion')}, of the model description {model.version}"
        yield finding("terminal-version", TERMINALS, what)
    causalities = {v.name: v.causality for v in model.variables}
    causalities |= {name: v.causality for v in model.variables for name, *_ in v.aliases}
    for parent in root.iter("Terminals", "Terminal"):
        siblings = Counter(child.get("name") for child in parent.findall("Terminal"))
        for name, times in siblings.items():
            if times > 1:
                what = f"{times} terminals are named {name!r}"
                yield finding("terminal-twice", _place(parent), what)
    for terminal in root.iter("Terminal"):
        yield from _members(terminal, causalities)
    for picture in root.iter("TerminalGraphicalRepresentation"):
        icon = f"terminalsAndIcons/{picture.get('iconBaseName')}.png"
        if icon not in names:
            yield finding("terminal-icon", _place(picture), f"{icon} is not packed")


def _members(terminal: Any, causalities: dict[str, str]) -> Iterator[Finding]:
    """Check the members of one terminal, not of those inside it."""
    members = terminal.findall("TerminalMemberVariable")
    streams = terminal.findall("TerminalStreamMemberVariable")
    if terminal.get("matchingRule") in ("plug", "bus"):
        for name, times in Counter(member.get("memberName") for member in members).items():
            if name is None or times > 1:
                what = "a member without a name" if name is None else f"{times} members {name!r}"
                yield finding("terminal-member", _place(terminal), what)
    for member in (*members, *streams):
        yield from _member(member, causalities)
    flows = [m for m in members if m.get("variableKind") in ("inflow", "outflow")]
    if streams and len(flows) > 1:
        what = f"{len(flows)} flows beside a stream"
        yield finding("terminal-member", _place(terminal), what)


def _member(member: Any, causalities: dict[str, str]) -> Iterator[Finding]:
    for key in _NAMED:
        name = member.get(key)
        if name is None:
            continue
        causality = causalities.get(name)
        kind = member.get("variableKind", "stream")
        if causality is None:
            yield finding("terminal-member", _place(member), f"{name!r} is not a variable")
        elif kind in ("signal", "inflow", "outflow", "stream") and causality not in _CONNECTED:
            what = f"{name} is of causality {causality}, its kind is {kind}"
            yield finding("terminal-member", _place(member), what)


def _place(element: Any) -> str:
    return f"{TERMINALS}:{element.sourceline}"


def build_findings(root: Any, model: DeclaredModel) -> Iterator[Finding]:
    """Check a build description, `root`, against the model description."""
    identifiers = {interface.identifier for interface in model.interfaces}
    platforms = Counter(
        (each.get("modelIdentifier"), each.get("platform"))
        for each in root.iter("BuildConfiguration")
    )
    for (identifier, platform), times in platforms.items():
        if identifier not in identifiers:
            what = f"modelIdentifier {identifier!r} is not in the model description"
            yield finding("build-identifier", BUILD, what)
        if platform is None and times > 1:
            what = f"{times} build configurations of {identifier} without a platform"
            yield finding("build-twice", BUILD, what)
    for each in root.iter("SourceFileSet"):
        if each.get("compilerOptions") is not None and each.get("compiler") is None:
            what = "compilerOptions without compiler"
            yield finding("build-compiler", f"{BUILD}:{each.sourceline}", what)
