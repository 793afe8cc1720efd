"""The commands below `cosim`, found as the parser finds them: each is loaded when it is named."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import typer.main

from cosim.cli import app


class Found(NamedTuple):
    """A command or group.

    Attributes
    ----------
    path : its words after `cosim`.
    listed : as its group has it before it is named: name, help and whether it is hidden.
    command : itself, with its parameters and what is below it.
    """

    path: tuple[str, ...]
    listed: Any
    command: Any

    @property
    def words(self) -> str:
        """Its words as one line."""
        return " ".join(self.path)

    @property
    def is_leaf(self) -> bool:
        """Whether no command is below it."""
        return not hasattr(self.command, "commands")


def leaf_of(words: list[str]) -> tuple[Any, Any, list[str]]:
    """Return the command that a line names, its context before it is parsed, and the rest."""
    node: Any = typer.main.get_command(app)
    context, rest = None, list(words)
    while hasattr(node, "resolve_command") and rest and not rest[0].startswith("-"):
        context = node.context_class(node, info_name=node.name, parent=context)
        _, node, rest = node.resolve_command(context, rest)
    return node, context, rest


@cache
def every_command() -> tuple[Found, ...]:
    """Every command and group below `cosim`, hidden ones too."""
    return tuple(_below(typer.main.get_command(app), ()))


def listed_commands() -> Iterator[Found]:
    """Yield those that a list of commands shows: not hidden, nor below what is hidden."""
    hidden = {found.path for found in every_command() if found.listed.hidden}
    for found in every_command():
        if hidden.isdisjoint(found.path[: end + 1] for end in range(len(found.path))):
            yield found


def _below(group: Any, path: tuple[str, ...]) -> Iterator[Found]:
    """Yield what is in a group, each before what is below it."""
    for name, listed in list(getattr(group, "commands", {}).items()):
        context = group.context_class(group, info_name=name)
        _, command, _ = group.resolve_command(context, [name])
        yield Found((*path, name), listed, command)
        yield from _below(command, (*path, name))
