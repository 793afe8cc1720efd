"""The options that say how a log of messages is written: one for each key of a `LogFormat`."""

from __future__ import annotations

import functools
import inspect
import shlex
from collections.abc import Callable
from typing import Annotated, Any, Literal, get_type_hints

import typer

from cosim.cli.arguments import number_or_text
from cosim.core import seconds
from cosim.network import ChoiceKey, DeclaredKey, DurationKey, LogFormat, TextKey, keys_of

_PANEL = "How a log is written"
_LITERAL: Any = Literal


def with_log_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a command these options; it is called with the `log_format` that they say."""
    declared = keys_of(LogFormat)

    @functools.wraps(verb)
    def with_format(**given: Any) -> None:
        keys = {key: given.pop(key) for key in declared}
        verb(**given, log_format=_log_format(keys))

    own = inspect.signature(verb)
    hints = get_type_hints(verb, include_extras=True)
    parameters = [
        parameter.replace(annotation=hints[name])
        for name, parameter in own.parameters.items()
        if name != "log_format"
    ]
    options = [
        inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=_type(each))
        for key, each in declared.items()
    ]
    with_format.__signature__ = own.replace(parameters=[*parameters, *options])  # type: ignore[attr-defined]
    with_format.__annotations__ = {p.name: p.annotation for p in (*parameters, *options)}
    return with_format


def option_words(log_format: LogFormat) -> list[str]:
    """Return the options that say this format, as they are typed."""
    plain = LogFormat(hints="options")
    given: dict[str, Any] = {}
    for key, found in keys_of(LogFormat).items():
        value = getattr(log_format, found.field)
        if value != getattr(plain, found.field):
            given[key] = value / 1e9 if isinstance(found.key, DurationKey) else value
    return shlex.split(plain.named(**given))


def _log_format(keys: dict[str, Any]) -> LogFormat:
    """Return the format that options say."""
    declared = keys_of(LogFormat)
    given: dict[str, Any] = {}
    for key, value in keys.items():
        if value is None:
            continue
        found = declared[key]
        if isinstance(found.key, DurationKey):
            option = f"--{key.replace('_', '-')}"
            given[found.field] = round(seconds(number_or_text(value), option) * 1e9)
        elif value:
            given[found.field] = tuple(value) if isinstance(value, list) else value
    return LogFormat(**given, hints="options")


def _type(found: DeclaredKey) -> Any:
    """Return the type of the option of a key."""
    name = f"--{found.name.replace('_', '-')}"
    text = found.key.text[0].upper() + found.key.text[1:]
    metavar = None
    match found.key:
        case ChoiceKey(words=words):
            kind: Any = _LITERAL[words]
        case TextKey(several=True):
            kind, metavar, text = list[str], "<str>", f"{text}; may be repeated"
        case DurationKey():
            kind, text = str, f"{text}: 0.25, '250 ms'"
        case _:
            kind = str
    option = typer.Option(name, help=f"{text}.", metavar=metavar, rich_help_panel=_PANEL)
    return Annotated[kind | None, option]
