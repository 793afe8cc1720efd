"""Help pages of the commands: plain text that wraps at any width, with examples that can be copied.

The help of a command is its docstring: paragraphs, which are wrapped, and a last block that begins
with \\b, its examples, one command line each.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup

Verb = TypeVar("Verb", bound=Callable[..., Any])
_WIDE = 76
_COLUMNS = (30, 14)
"""Width of the names of options, on a wide and on a narrow terminal."""
_WORD = re.compile(r"""(?:[^\s'"]|'[^']*'|"[^"]*")+""")
_PANEL = "rich_help_panel"


class _HelpPage:
    """What the help pages of commands and groups have in common; comes before typer's class."""

    help: str | None

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help page."""
        _adapt(formatter)
        super().format_help(ctx, formatter)  # type: ignore[misc]

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the paragraphs, and the examples under a heading of their own."""
        del ctx
        _write_text(self.help, formatter)


class HelpCommand(_HelpPage, TyperCommand):
    """A command whose help is written by this module."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, those of a panel under its title."""
        sections: dict[str, list[Any]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            usual = "Arguments" if parameter.param_type_name == "argument" else "Options"
            if record is not None:
                title = getattr(parameter, _PANEL, None) or usual
                sections.setdefault(title, []).append(record)
        options = sections.pop("Options", [])
        arguments = sections.pop("Arguments", [])
        for title, rows in (("Arguments", arguments), *sections.items(), ("Options", options)):
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


class HelpGroup(_HelpPage, TyperGroup):
    """A group of commands whose help is written by this module."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands with their whole first sentence."""
        found = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        rows = [
            (name, " ".join((command.help or "").partition("\n\n")[0].split()))
            for name, command in found
            if command is not None and not command.hidden
        ]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


class HelpTyper(typer.Typer):
    """A typer application of such commands; it lists them where none is given."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**({"cls": HelpGroup, "no_args_is_help": True, **settings}))

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Verb], Verb]:
        """Return the decorator that adds a command."""
        return super().command(name, **({"cls": HelpCommand, **settings}))


def _adapt(formatter: Any) -> None:
    """Give the names of options less room where there is little."""
    wide, narrow = _COLUMNS
    most = wide if formatter.width >= _WIDE else narrow
    formatter.write_dl = partial(formatter.write_dl, col_max=most)


def _write_text(text: str | None, formatter: Any) -> None:
    for paragraph in inspect.cleandoc(text or "").split("\n\n"):
        if not paragraph.lstrip().startswith("\b"):
            formatter.write_paragraph()
            with formatter.indentation():
                formatter.write_text(" ".join(paragraph.split()))
            continue
        with formatter.section("Examples"):
            for line in paragraph.splitlines()[1:]:
                formatter.write(_wrapped(line.strip(), formatter.width, formatter.current_indent))


def _wrapped(line: str, width: int, indent: int) -> str:
    r"""Return a command line within a width; where it is cut, a \ joins it in a shell."""
    rows = [" " * indent]
    for part in _parts(line):
        if rows[-1].strip() and len(rows[-1]) + len(part) + 3 > width:
            rows[-1] += " \\"
            rows.append(" " * (indent + 4))
        rows[-1] += f" {part}" if rows[-1].strip() else part
    return "\n".join(rows) + "\n"


def _parts(line: str) -> list[str]:
    """Return the words of a command line, each option with its value."""
    parts: list[str] = []
    for word in _WORD.findall(line):
        if parts and parts[-1].startswith("-") and " " not in parts[-1] and word[0] != "-":
            parts[-1] += f" {word}"
        else:
            parts.append(word)
    return parts
