"""The command `cosim`: its sub-commands, and how errors become messages and exit codes."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from cosim.cli.first_hour import FIRST_HOUR
from cosim.cli.help_text import HelpTyper
from cosim.cli.verbs import STYLE, VerbsOnUse
from cosim.core import CosimError, InputError

app = HelpTyper(
    name="cosim",
    cls=VerbsOnUse,
    no_args_is_help=False,
    invoke_without_command=True,
    context_settings={"max_content_width": 120},
    epilog="cosim alone shows where to begin; the --help of every command has examples.",
    **(STYLE | {"add_completion": True}),
)

# typer may contain its own copy of click: this is the usage error of the copy that it uses
_UsageError: Any = typer.BadParameter.__base__
_INTERRUPTED = 130  # typer returns it after a KeyboardInterrupt
_TERMINATED = 128 + signal.SIGTERM
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
        with _sigterm_as_interrupt():
            code = app(standalone_mode=False, prog_name="cosim") or 0
    except _Ended:
        code = _TERMINATED
    except CosimError as error:
        _complain(error, error.exit_code, as_json=as_json)
        sys.exit(error.exit_code)
    except _UsageError as error:
        sys.exit(_misused(error, as_json=as_json))
    except SystemExit as end:  # typer raises it on a BrokenPipeError, with code 1
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        # the reader of the output is gone: nobody is left to print a message for
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except Exception as error:
        if os.environ.get("COSIM_DEBUG"):
            raise
        unexpected = CosimError(
            f"unexpected {type(error).__name__}: {error}",
            hint="set COSIM_DEBUG=1 to see the traceback, and report it",
        )
        _complain(unexpected, 4, as_json=as_json)
        sys.exit(4)
    if code in (_INTERRUPTED, _TERMINATED):
        what = "interrupted" if code == _INTERRUPTED else "terminated"
        _complain(CosimError(what, hint=_LEFT_BEHIND), code, as_json=as_json)
    sys.exit(code)


class _Ended(SystemExit):
    """Raised on SIGTERM, so that traces are closed and temporary folders removed."""


@contextmanager
def _sigterm_as_interrupt() -> Iterator[None]:
    """Make SIGTERM end the command in an orderly way, as Ctrl-C does."""

    def leave(_number: int, _frame: object) -> None:
        raise _Ended(_TERMINATED)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    except SystemExit as end:
        if end.code == _TERMINATED:
            raise _Ended(_TERMINATED) from None
        raise
    finally:
        signal.signal(signal.SIGTERM, before)


def _misused(error: Any, *, as_json: bool) -> int:
    """Print a usage error like all other errors; without any sub-command, print the help."""
    if type(error).__name__ == "NoArgsIsHelpError" and not as_json:
        error.show()
    else:
        path = error.ctx.command_path if error.ctx else "cosim"
        wrong = InputError(_plain(error.format_message()), where=path, hint=_hint(error, path))
        _complain(wrong, wrong.exit_code, as_json=as_json)
    return InputError.exit_code


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


def _complain(error: CosimError, code: int, *, as_json: bool) -> None:
    if as_json:
        content = error.to_json() | {"exit_code": code}
        print(json.dumps({"error": content}, allow_nan=False))
    print(error.text(), file=sys.stderr)
