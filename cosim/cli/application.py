"""The command `cosim`: its sub-commands, and how errors become messages and exit codes."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import sys
from contextlib import suppress
from typing import Annotated, Any

import typer
import typer.main

from cosim.cli.first_hour import FIRST_HOUR
from cosim.cli.help_text import HelpTyper
from cosim.cli.interruptions import interruptions
from cosim.cli.verbs import STYLE, VerbsOnUse
from cosim.core import CosimError, InputError, LossError

app = HelpTyper(
    name="cosim",
    cls=VerbsOnUse,
    no_args_is_help=False,
    invoke_without_command=True,
    context_settings={"max_content_width": 120},
    epilog="Run cosim without arguments to see where to begin; the --help of every command "
    "has examples.",
    **(STYLE | {"add_completion": True}),
)
"""Every command and group, for who reads or calls them in a process; `main` is the command."""

# typer may contain its own copy of click: this is the usage error of the copy that it uses
_UsageError: Any = typer.BadParameter.__base__
_INTERRUPTED = 130  # typer returns it after a KeyboardInterrupt
_TERMINATED = 128 + signal.SIGTERM
_UNEXPECTED = 4
_DESCRIPTORS = 256  # enough for the usual run
_LEFT_BEHIND = "if a run had begun: cosim trace recover turns the .partial file into a trace"


def _version(asked: bool) -> None:  # noqa: FBT001 - typer calls it so
    if asked:
        import importlib.metadata  # noqa: PLC0415 - a tenth of the time of a help text

        print(f"auv-cosim {importlib.metadata.version('auv-cosim')}")
        raise typer.Exit


@app.callback()
def common(
    context: typer.Context,
    *,
    version: Annotated[  # noqa: ARG001 - its callback has done it
        bool,
        typer.Option("--version", help="Print the version.", callback=_version, is_eager=True),
    ] = False,
) -> None:
    """Design, prove and co-simulate control over slow links; record, replay and study the runs."""
    if context.invoked_subcommand is None:
        print(FIRST_HOUR)


def main() -> None:
    """Run the command line; turn errors into messages and exit codes, never tracebacks."""
    as_json = "--json" in sys.argv[1:]
    try:
        with interruptions.raised():
            code = app(standalone_mode=False, prog_name="cosim") or _printed()
        if code in (0, _INTERRUPTED) and (number := interruptions.number or code):
            # of a signal that was dropped, the command has ended before it came again
            code = _interrupted(number % 128, as_json=as_json)
    except SystemExit as end:
        code = _left(end, as_json=as_json)
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - each has its message
        code = _failed(error, as_json=as_json)
    sys.exit(code)


def _left(end: SystemExit, *, as_json: bool) -> Any:
    """Return the exit code of a command that has left by itself."""
    if isinstance(end.__context__, BrokenPipeError):  # typer raises code 1 then
        return _unheard()
    return _interrupted(signal.SIGTERM, as_json=as_json) if end.code == _TERMINATED else end.code


def _failed(error: BaseException, *, as_json: bool) -> int:
    """Say what is wrong; return the exit code."""
    if isinstance(error, CosimError):
        if error.hint is None and isinstance(error, InputError):
            error.hint = f"{_command()} --help"
        _complain(error, error.exit_code, as_json=as_json)
        return error.exit_code
    if isinstance(error, _UsageError):
        return _misused(error, as_json=as_json)
    # any other error after a signal comes of it
    if isinstance(error, KeyboardInterrupt) or interruptions.number:
        return _interrupted(interruptions.number or signal.SIGINT, as_json=as_json)
    if isinstance(error, OSError) and (refused := _refused(error)) is not None:
        _complain(refused, refused.exit_code, as_json=as_json)
        return refused.exit_code
    if os.environ.get("COSIM_DEBUG"):
        raise error
    unexpected = CosimError(
        f"unexpected {type(error).__name__}: {error}",
        hint="set COSIM_DEBUG=1 to see the traceback, and report it",
    )
    _complain(unexpected, _UNEXPECTED, as_json=as_json)
    return _UNEXPECTED


def _printed() -> int:
    """Return the exit code of a command that went well, once its output is where it goes."""
    try:
        print(end="", flush=True)
    except BrokenPipeError:
        return _unheard()
    return 0


def _unheard() -> int:
    """The reader of the output is gone: nobody is left to print a message for."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 141


def _refused(error: OSError) -> CosimError | None:
    """Return the error of a system that has no more of something; None for any other fault."""
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return InputError(
            "too few file descriptors: no more files can be opened",
            where=None if error.filename is None else str(error.filename),
            expected=f"a limit of at least {_DESCRIPTORS} for this process",
            got=error.strerror,
            hint=f"ulimit -n {_DESCRIPTORS}, in the shell before this command; or fewer workers",
        )
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return LossError("the output has no room", got=str(error), hint="make room on the disk")
    return None


def _interrupted(number: int, *, as_json: bool) -> int:
    """Say that a signal has ended the command; return the exit code."""
    what = "terminated" if number == signal.SIGTERM else "interrupted"
    _complain(CosimError(what, hint=_LEFT_BEHIND), 128 + number, as_json=as_json)
    return 128 + number


def _misused(error: Any, *, as_json: bool) -> int:
    """Print a usage error like all other errors; without any sub-command, print the help."""
    if type(error).__name__ == "NoArgsIsHelpError" and not as_json:
        error.show()
    else:
        path = error.ctx.command_path if error.ctx else "cosim"
        wrong = InputError(_plain(error.format_message()), where=path, hint=_hint(error, path))
        _complain(wrong, wrong.exit_code, as_json=as_json)
    return InputError.exit_code


def _command() -> str:
    """Return the words of the command line that name the command."""
    node: Any = typer.main.get_command(app)
    words = ["cosim"]
    for word in sys.argv[1:]:
        if word not in getattr(node, "commands", {}):
            break
        words.append(word)
        context = node.context_class(node, info_name=node.name)
        node = node.resolve_command(context, [word])[1]
    return " ".join(words)


_PLAIN = {
    "Value error, ": "",
    "Input should be a valid number, unable to parse string as a number": "a number is expected, "
    "without a unit",
    "Input should be a valid integer, unable to parse string as an integer": "a whole number is "
    "expected, without a unit",
}
"""Words of the parser, and plain ones."""
_OPTIONS = {
    "stop-time": "--until",
    "end": "--until",
    "duration": "--until",
    "step-size": "--set run.step=...",
    "step": "--set run.step=...",
    "seed": "--set run.seed=...",
    "output": "--out",
}
"""Options of other tools, and what they are here."""


def _plain(message: str) -> str:
    for words, plain in _PLAIN.items():
        message = message.replace(words, plain)
    return message


def _hint(error: Any, path: str) -> str:
    """Return where to look, and the option that is meant by one of another tool."""
    meant = _OPTIONS.get(str(getattr(error, "option_name", "")).lstrip("-"))
    known = meant is not None and any(meant.split()[0] in p.opts for p in error.ctx.command.params)
    return f"{meant}; {path} --help" if known else f"{path} --help"


_ARGUMENT = re.compile(r"`([a-z][a-z_]*)`")
"""An argument as a message names it, which a caller in Python reads as well."""


def _with_options(error: CosimError) -> CosimError:
    """Name the options for the arguments in backticks: `gain_limit` becomes --gain-limit."""

    def named(text: str | None) -> str | None:
        if text is None:
            return None
        return _ARGUMENT.sub(lambda match: f"--{match[1].replace('_', '-')}", text)

    parts = {key: named(getattr(error, key)) for key in ("where", "expected", "hint")}
    return CosimError(error.what, got=error.got, **parts)


def _complain(error: CosimError, code: int, *, as_json: bool) -> None:
    error = _with_options(error)
    if as_json:
        content = error.to_json() | {"exit_code": code}
        with suppress(OSError, ValueError):  # where nothing can be printed the exit code says it
            print(json.dumps({"error": content}, allow_nan=False), flush=True)
    with suppress(OSError, ValueError):
        print(error.text(), file=sys.stderr, flush=True)
