"""The reference of the command line, from the commands themselves."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer.main

from cosim.cli.application import app
from cosim.cli.verbs import VERBS, loaded

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
    for name, verb in VERBS.items():
        if not verb.hidden:
            parts += commands(loaded(name, verb), f"cosim {name}", 2)
    return "\n\n".join(parts) + "\n"


def commands(command: Any, path: str, level: int) -> Iterator[str]:
    """Give the sections of a command and of those below it."""
    yield f"{'#' * level} {path}"
    yield help_text(command.help or "")
    inner = getattr(command, "commands", None)
    if inner is None:
        places = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join([path, *(f"{p.name.upper()}" for p in places), "[OPTIONS]"])
        yield f"```text\n{usage}\n```"
        table = [row(p) for p in command.params if not getattr(p, "hidden", False)]
        yield "\n".join(["| | takes | default | meaning |", "|---|---|---|---|", *table])
        return
    for name in inner:
        found = inner[name]
        if not found.hidden:
            found = getattr(command, "get_command", lambda _context, n: inner[n])(None, name)
            yield from commands(_whole(command, name, found), f"{path} {name}", level + 1)


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


def _whole(group: Any, name: str, found: Any) -> Any:
    """Return the command itself where the group has its first line alone."""
    verbs = getattr(type(group), "verbs", {})
    return loaded(name, verbs[name]) if name in verbs else found


def _plain(text: str | None) -> str:
    """Return text of the help without the markup of the terminal, safe in a table."""
    found = re.sub(r"\[/?(?:bold|dim|italic|cyan|green|yellow|red)\]", "", text or "")
    found = found.replace("\\[", "[").replace("|", "\\|").replace("<", "&lt;")
    return " ".join(re.sub(r"(?<![`\w-])(--[a-z][a-z-]*)", r"`\1`", found).split())
