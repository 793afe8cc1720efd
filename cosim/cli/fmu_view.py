"""Results of `cosim fmu`, formatted for a terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from cosim.fmu import LEVELS, RULES, Inspection, Rule, printable

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def check_view(file: str, found: Inspection) -> RenderableType:
    """Show the verdict, then the findings by kind, with the reason once for each kind."""
    counts = [sum(each.level == level for each in found.findings) for level in LEVELS]
    counted = ", ".join(
        f"{n} {level}{'' if n == 1 else 's'}" for n, level in zip(counts, LEVELS, strict=True)
    )
    verdict = ("no errors", "bold green") if found.valid else ("not valid", "bold red")
    parts: list[RenderableType] = [Text.assemble(verdict, f": {file}\n{counted}")]
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
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    rows = {
        "rule": f"{rule.number} {rule.code}",
        "usually": rule.level,
        "why": rule.why,
        "standard": rule.sections or "none asks for it",
        "breaks it": rule.example,
        "instead of": " ".join(rule.old.split()),
    }
    for label, value in rows.items():
        if value:
            table.add_row(label, Text(value))
    return table


def info_view(answer: dict[str, Any]) -> RenderableType:
    """Show an FMU, from the data of `fmu_facts`."""
    model = answer["model"]
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()

    def row(label: str, value: Any) -> None:
        if value not in (None, "", []):
            table.add_row(label, Text(printable(str(value))))

    row("model", model["name"])
    row("description", model["description"])
    row("FMI", model["fmi_version"])
    for kind in model["kinds"]:
        able = ", ".join(kind["capabilities"]) or "no optional capabilities"
        row(kind["kind"], f"{kind['identifier']}: {able}")
    row("made by", model["generation_tool"])
    row("version", model["version"])
    row("author", model["author"])
    row("licence", model["license"])
    row("token", model["token"])
    for variables in model["variables"]:
        row(f"{variables['causality']} {variables['type']}", variables["count"])
    row("units", ", ".join(model["units"]))
    experiment = ", ".join(f"{k} {v:g}" for k, v in model["default_experiment"].items())
    row("default experiment", experiment)
    for binary in answer["binaries"]:
        row(binary["file"], binary["damage"] or binary["unread"])
        if binary["unexamined"] is not None:
            row(binary["file"], "headers not read: pip install 'auv-cosim[check]'")
        for image in binary["images"]:
            row(binary["file"], _image(image))
    row("sources", f"{answer['sources']} files" if answer["sources"] else "none")
    row("documentation", "yes" if answer["documentation"] else "none")
    row("size", f"{answer['bytes']} bytes, unpacked {answer['unpacked_bytes']}")
    row("SHA-256", answer["sha256"])
    row("runs on this machine", "there is a binary" if answer["runs_here"] else "no binary")
    findings = ", ".join(f"{n} {level}s" for level, n in answer["findings"].items() if n)
    row("findings", f"{findings or 'none'} (cosim fmu check)")
    return table


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
