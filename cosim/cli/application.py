"""The command `cosim`: its verbs, and what becomes of an error."""

from __future__ import annotations

import importlib.metadata
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from cosim.cli.certificate import certificate_app
from cosim.cli.design import analyse, design
from cosim.cli.fmu import fmu_app
from cosim.cli.fmu_build import build
from cosim.cli.fmu_controller import controller
from cosim.cli.paper import paper
from cosim.cli.run import demo, run
from cosim.cli.scenario import list_scenarios, scenario_app
from cosim.cli.ssp import ssp_app
from cosim.cli.study import study_app
from cosim.cli.trace import trace_app
from cosim.cli.trace_diff import diff
from cosim.cli.trace_export import export
from cosim.cli.trace_inject import inject
from cosim.cli.trace_live import play, view
from cosim.cli.trace_recover import recover, verify
from cosim.cli.trace_report import report
from cosim.core import CosimError, InputError

app = typer.Typer(
    name="cosim",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Certified control of an underwater vehicle over delayed links: design, fly, trace.",
    epilog="Start with [bold]cosim demo[/bold], then [bold]cosim scenario list[/bold].",
)
for verb in (demo, design, analyse, paper, run):
    app.command()(verb)
app.command("scenarios", hidden=True)(list_scenarios)  # its name before `scenario list`
app.add_typer(scenario_app, name="scenario")
app.add_typer(trace_app, name="trace")
for trace_verb in (report, play, view):
    trace_app.command()(trace_verb)
app.add_typer(certificate_app, name="certificate")
app.add_typer(fmu_app, name="fmu")
app.add_typer(ssp_app, name="ssp")
app.add_typer(study_app, name="study")
fmu_app.command()(build)
fmu_app.command()(controller)
trace_app.command()(recover)
trace_app.command()(verify)
trace_app.command()(export)
trace_app.command()(diff)
trace_app.command()(inject)

# typer may bring its own copy of click: this is the usage error of the one it uses
_UsageError: Any = typer.BadParameter.__base__
_INTERRUPTED = 130  # what typer makes of a KeyboardInterrupt
_TERMINATED = 128 + signal.SIGTERM
_LEFT_BEHIND = "cosim trace recover makes a trace of the .partial file, if a run had begun"


def _version(asked: bool) -> None:  # noqa: FBT001 - typer calls it so
    if asked:
        print(f"auv-cosim {importlib.metadata.version('auv-cosim')}")
        raise typer.Exit


@app.callback()
def common(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Say which version this is.", callback=_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Certified control of an underwater vehicle over delayed links: design, fly, trace."""


def main() -> None:
    """Entry point: errors become messages and exit codes, never tracebacks."""
    as_json = "--json" in sys.argv[1:]
    try:
        with _sigterm_as_interrupt():
            code = app(standalone_mode=False) or 0
    except _Ended:
        code = _TERMINATED
    except CosimError as error:
        _complain(error, error.exit_code, as_json=as_json)
        sys.exit(error.exit_code)
    except _UsageError as error:
        sys.exit(_misused(error, as_json=as_json))
    except SystemExit as end:  # which typer makes of a BrokenPipeError, with code 1
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        # the reader of our output is gone: nothing is left to say it to
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except Exception as error:
        if os.environ.get("COSIM_DEBUG"):
            raise
        unexpected = CosimError(
            f"unexpected {type(error).__name__}: {error}",
            hint="set COSIM_DEBUG=1 for the traceback, and report it",
        )
        _complain(unexpected, 4, as_json=as_json)
        sys.exit(4)
    if code in (_INTERRUPTED, _TERMINATED):
        what = "interrupted" if code == _INTERRUPTED else "told to end"
        _complain(CosimError(what, hint=_LEFT_BEHIND), code, as_json=as_json)
    sys.exit(code)


class _Ended(SystemExit):
    """SIGTERM: traces are closed and temporary folders removed on the way out."""


@contextmanager
def _sigterm_as_interrupt() -> Iterator[None]:
    """SIGTERM ends the command as Ctrl-C does, not in the middle of what it is doing."""

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
    """Usage errors in the form of all others; without any verb, the help."""
    if type(error).__name__ == "NoArgsIsHelpError" and not as_json:
        error.show()
    else:
        path = error.ctx.command_path if error.ctx else "cosim"
        wrong = InputError(error.format_message(), where=path, hint=f"{path} --help")
        _complain(wrong, wrong.exit_code, as_json=as_json)
    return InputError.exit_code


def _complain(error: CosimError, code: int, *, as_json: bool) -> None:
    if as_json:
        keys = ("what", "where", "expected", "got", "hint")
        content = {key: getattr(error, key) for key in keys} | {"exit_code": code}
        print(json.dumps({"error": content}, allow_nan=False))
    print(error.text(), file=sys.stderr)
