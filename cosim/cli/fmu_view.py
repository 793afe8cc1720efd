"""Results of `cosim fmu`, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from cosim.cli.terminal import table
from cosim.core import counted
from cosim.fmu.inspect import LEVELS, RULES, Inspection, Rule, printable

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def check_line(file: str, found: Inspection) -> str:
    """Say whether an FMU is valid, and how many findings of each level there are."""
    counts = [sum(each.level == level for each in found.findings) for level in LEVELS]
    totals = ", ".join(counted(n, level) for n, level in zip(counts, LEVELS, strict=True) if n)
    return f"{'no errors' if found.valid else 'not valid'}: {file}; {totals or 'nothing found'}"


def check_view(found: Inspection) -> RenderableType:
    """Show the findings by kind, with the reason once for each kind."""
    parts: list[RenderableType] = []
    for level in LEVELS:
        kinds: dict[str, list[Text]] = {}
        reasons = {}
        for each in found.findings:
            if each.level == level:
                place = f"{each.where}: " if each.where else ""
                kinds.setdefault(each.code, []).append(Text(f"{place}{each.what}"))
                reasons[each.code] = each.why
        for code, lines in kinds.items():
            name = f" {code} ({RULES[code].number})"
            parts.append(Text.assemble((level, f"bold {_COLOURS[level]}"), name))
            parts += [Padding(line, (0, 0, 0, 2)) for line in lines]
            parts.append(Padding(Text(reasons[code], style="dim"), (0, 0, 0, 4)))
    return Group(*parts)


def rule_view(rule: Rule) -> RenderableType:
    """Explain a rule of the check."""
    rows = {
        "rule": f"{rule.number} {rule.code}",
        "usually": rule.level if rule.runs else f"{rule.level}; no run takes the FMU",
        "why": rule.why,
        "standard": rule.sections or "none asks for it",
        "breaks it": rule.example,
        "instead of": " ".join(rule.old.split()),
    }
    return table("*|", ((label, value) for label, value in rows.items() if value))


def info_view(answer: dict[str, Any]) -> RenderableType:
    """Show an FMU, from the data of `fmu_facts`."""
    rows = (
        (label, Text(printable(str(value))))
        for label, value in _info(answer, answer["model"])
        if value not in (None, "", [])
    )
    return Group(*_interface(answer["model"]), table("*|", rows))


def info_line(answer: dict[str, Any]) -> str:
    """Say in one line what an FMU is, whether it runs here, and what is wrong with it."""
    model = answer["model"]
    kinds = " and ".join(kind["kind"] for kind in model["kinds"]) or "no kind of use"
    here = "has a binary for this machine" if answer["runs_here"] else "no binary for this machine"
    name = printable(str(model["name"]))
    return f"{name}: FMI {model['fmi_version']}, {kinds}; {here}; {_findings(answer)}"


def _findings(answer: dict[str, Any]) -> str:
    counts = answer["findings"].items()
    found = ", ".join(counted(n, level) for level, n in counts if n)
    return f"cosim fmu check: {found or 'nothing found'}"


def _interface(model: dict[str, Any]) -> Iterator[RenderableType]:
    """Yield what can be connected and set: inputs, outputs, parameters."""
    for causality, word in _WORDS.items():
        found = [v for v in model["interface"] if v["causality"] == causality]
        if not found:
            continue
        rows = [
            (
                Text(printable(v["name"])),
                Text(printable(v["unit"] or "")),
                Text(printable("" if v["start"] is None else str(v["start"])[:_START])),
                Text(printable(v["description"] or "")),
            )
            for v in found[:_MOST]
        ]
        if len(found) > _MOST:
            rows.append((Text(f"and {len(found) - _MOST} more: --json"), Text(), Text(), Text()))
        title = counted(len(found), word)
        yield table((title, "unit", "start", ""), rows)


_WORDS = {
    "input": "input",
    "output": "output",
    "parameter": "parameter",
    "structuralParameter": "structural parameter",
}
_MOST, _START = 24, 12
"""Variables of a causality that are listed, and characters of a start value."""


def _info(answer: dict[str, Any], model: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    yield "model", model["name"]
    yield "description", model["description"]
    yield "FMI", model["fmi_version"]
    for kind in model["kinds"]:
        able = ", ".join(kind["capabilities"]) or "no optional capabilities"
        yield kind["kind"], f"{kind['identifier']}: {able}"
    yield "made by", model["generation_tool"]
    yield "version", model["version"]
    yield "author", model["author"]
    yield "licence", model["license"]
    yield "token", model["token"]
    for variables in model["variables"]:
        yield f"{variables['causality']} {variables['type']}", variables["count"]
    yield "units", ", ".join(model["units"])
    experiment = ", ".join(f"{k} {v:g}" for k, v in model["default_experiment"].items())
    yield "default experiment", experiment
    for binary in answer["binaries"]:
        yield binary["file"], binary["damage"] or binary["unread"]
        if binary["unexamined"] is not None:
            yield binary["file"], "headers not read: pip install 'auv-cosim[check]'"
        for image in binary["images"]:
            yield binary["file"], _image(image)
    yield "sources", counted(answer["sources"], "file") if answer["sources"] else "none"
    yield "documentation", "yes" if answer["documentation"] else "none"
    yield "size", f"{answer['bytes']} bytes, unpacked {answer['unpacked_bytes']}"
    yield "SHA-256", answer["sha256"]


def _image(image: dict[str, Any]) -> str:
    parts = [f"{image['format']} for {image['architecture']} {image['system']}"]
    parts.append(f"{image['fmi_functions']} FMI functions")
    if image["libraries"]:
        parts.append("needs " + ", ".join(image["libraries"]))
    if image["glibc"]:
        parts.append(f"glibc {image['glibc']} or newer")
    if image["needs_python"]:
        parts.append("a Python host")
    return "; ".join(parts)
