"""The reference of the command line, from the commands themselves."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer.main

from cosim.cli.application import app

_KINDS = {str: "text", int: "whole number", float: "number", Path: "path", list[str]: "text"}
_SHOWN = (str, int, float, Path)
_HEAD = """# Command line

Every command takes `--help`; those that print results take `--json`. This page is generated from
the commands.

| exit code | meaning |
|---|---|
| 0 | done; a run that diverged is done, and reports it |
| 1 | an assertion or a comparison failed |
| 2 | bad input or usage |
| 3 | done with loss |
| 4 | a component failed or exceeded a limit |
| 5 | not achievable |
| 6 | a run contradicts its guarantee: a fault of this project, to be reported |
| 130 | interrupted |
"""


def page() -> str:
    """Return the page, in Markdown."""
    parts = [_HEAD]
    whole: Any = typer.main.get_command(app)
    rows = [f"| `{p.opts[0]}` | {_plain(p.help)} |" for p in whole.params if p.opts[0] != "--help"]
    parts.append("\n".join(["| option | meaning |", "|---|---|", *rows]))
    for words, command in listed():
        parts += section(command, words)
    return "\n\n".join(parts) + "\n"


def listed(group: Any = None, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each listed command and group with its words after `cosim`, before what is below it."""
    group = group or typer.main.get_command(app)
    for name, found in list(group.commands.items()):
        if found.hidden:
            continue
        context = group.context_class(group, info_name=name)
        _, command, _ = group.resolve_command(context, [name])  # loaded where it is named
        words = f"{path} {name}".strip()
        yield words, command
        if hasattr(command, "commands"):
            yield from listed(command, words)


def section(command: Any, words: str) -> Iterator[str]:
    """Yield the parts of the section of a command or group."""
    yield f"{'#' * (len(words.split()) + 1)} cosim {words}"
    yield help_text(command.help or "")
    if hasattr(command, "commands"):
        return
    places = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join(["cosim", words, *(f"{p.name.upper()}" for p in places), "[OPTIONS]"])
    yield f"```text\n{usage}\n```"
    table = [row(p) for p in command.params if not getattr(p, "hidden", False)]
    yield "\n".join(["| | takes | default | meaning |", "|---|---|---|---|", *table])


def row(parameter: Any) -> str:
    """Return the row of an option or argument."""
    if parameter.param_type_name == "argument":
        name = parameter.name.upper()
    else:
        name = ", ".join([*parameter.opts, *parameter.secondary_opts])
    kind = parameter.type_descriptor.annotation
    words = get_args(kind) if get_origin(kind) is Literal else ()
    takes = " or ".join(map(str, words)) or parameter.metavar or _KINDS.get(kind, "")
    default = parameter.default
    shown = f"`{default}`" if isinstance(default, _SHOWN) and default is not False else ""
    if parameter.required:
        shown = "required"
    return f"| `{name}` | {takes} | {shown} | {_plain(parameter.help)} |"


def help_text(text: str) -> str:
    """Return the help of a command as Markdown: what is not to be wrapped is a block."""
    paragraphs = []
    for paragraph in inspect.cleandoc(text).replace("\f", "").split("\n\n"):
        lines = paragraph.splitlines()
        if lines and lines[0].strip() == "\b":
            paragraphs.append("\n".join(["```text", *lines[1:], "```"]))
        else:
            paragraphs.append(_plain(" ".join(lines)))
    return "\n\n".join(paragraphs)


def _plain(text: str | None) -> str:
    """Return text of the help without the markup of the terminal, safe in a table."""
    found = re.sub(r"\[/?(?:bold|dim|italic|cyan|green|yellow|red)\]", "", text or "")
    found = found.replace("\\[", "[").replace("|", "\\|").replace("<", "&lt;")
    return " ".join(re.sub(r"(?<![`\w-])(--[a-z][a-z-]*)", r"`\1`", found).split())
