"""The command `cosim`: verbs only."""

from __future__ import annotations

import importlib.metadata
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cosim import show
from cosim.answers import analysis_json, design_json
from cosim.arguments import gain_from, named_problem, numbers, write
from cosim.errors import CheckFailedError, CosimError, InputError
from cosim.hinf import (
    DELAY_LIMIT,
    CertifiedDelay,
    GreatestDelay,
    certified_delay,
    check_certificate,
    design_to_json,
    greatest_delay,
    read_certificate,
    with_delays,
)
from cosim.hinf import analyse as make_analysis
from cosim.hinf import design as make_design
from cosim.replay import rerun as run_again
from cosim.scenario.assemble import Hangar
from cosim.scenario.demo import demonstrate
from cosim.scenario.execute import check_room, fly, prepare
from cosim.scenario.read import builtin_names, load
from cosim.trace import describe, render

app = typer.Typer(
    name="cosim",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Certified control of an underwater vehicle over delayed links: design, fly, trace.",
    epilog="Start with [bold]cosim demo[/bold], then [bold]cosim scenarios[/bold].",
)
trace_app = typer.Typer(no_args_is_help=True, help="Look into a trace, or run it again.")
app.add_typer(trace_app, name="trace")
certificate_app = typer.Typer(
    no_args_is_help=True, help="Check what a design or an analysis claims."
)
app.add_typer(certificate_app, name="certificate")

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object and nothing else on standard output.")
]
FmusOption = Annotated[
    Path, typer.Option("--fmus", help="Folder of the FMUs; what is missing is built there.")
]
# typer may bring its own copy of click: this is the usage error of the one it uses
_UsageError: Any = typer.BadParameter.__base__
_INTERRUPTED = 130  # what typer makes of a KeyboardInterrupt
_LEFT_BEHIND = "cosim trace info on the .partial file, if a run had begun"
_FMUS = Path("fmus")
_TRACES = Path("traces")


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


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for traces and picture.")] = _TRACES,
    fmus: FmusOption = _FMUS,
    as_json: JsonOption = False,
) -> None:
    """Design two gains, fly both over the same acoustic link, compare them in one picture."""
    with _progress() as tell:
        result = demonstrate(_hangar(fmus), out, tell)
    _print(as_json, result.to_json, lambda: show.demo_view(result))


@app.command()
def scenarios(*, as_json: JsonOption = False) -> None:
    """List the scenarios that come with the package."""
    rows = [{"name": name, "title": load(name).scenario.title} for name in builtin_names()]
    _print(as_json, lambda: {"scenarios": rows}, lambda: show.scenarios_view(rows))


@app.command()
def design(
    name: Annotated[
        str, typer.Argument(help="paper, auv, a scenario's name, or a system FILE.toml.")
    ],
    k1: Annotated[
        str | None, typer.Option(help="Free scalars k1, one per delay, as in -0.3,-1.0.")
    ] = None,
    k2: Annotated[str | None, typer.Option(help="Free scalars k2, one per delay.")] = None,
    gamma: Annotated[
        float | None, typer.Option(help="A bound to meet, instead of the least one.")
    ] = None,
    search: Annotated[
        bool, typer.Option("--search", help="Look for better k1, k2, from these among others.")
    ] = False,
    delays: Annotated[
        str | None, typer.Option(help="Delays instead of the system's own, as in 0.5,1.25 [s].")
    ] = None,
    max_delay: Annotated[
        bool,
        typer.Option(
            "--max-delay",
            help="The greatest delay for the given gamma: of the feedback, or else the first.",
        ),
    ] = False,
    delay_limit: Annotated[
        float, typer.Option(help="Where the search for a greatest delay ends [s].")
    ] = DELAY_LIMIT,
    save: Annotated[
        Path | None, typer.Option(help="Write the design with its exact certificate here (JSON).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Design the H-infinity gain of a system with delays, and prove it exactly.

    gamma bounds the gain from w to z for every admissible uncertainty and is certified in
    rational arithmetic for the gain as it flies; the exact norm and the abscissa of the
    nominal loop stand beside it. k1 and k2 are free, and worth a search.
    """
    named, gain = named_problem(name)
    system = named.system
    if delays is not None:
        system = with_delays(system, numbers("--delays", delays))
    scalars = (
        named.k1 if k1 is None else numbers("--k1", k1),
        named.k2 if k2 is None else numbers("--k2", k2),
    )
    goal = named.gamma if gamma is None else gamma
    reach: GreatestDelay | None = None
    with _progress() as tell:
        tell(f"design of {name}", 0.0)
        if max_delay:
            if gain is not None:
                raise InputError(
                    "this scenario gives its gain, and a greatest delay is designed for",
                    where="--max-delay",
                )
            which = next((j for j, delay in enumerate(system.delays) if delay.feedback), 0)
            reach = greatest_delay(
                system, goal, *scalars, which=which, limit=delay_limit, search=search
            )
            found = reach.design
        else:
            found = make_design(system, *scalars, gamma=goal, gain=gain, search=search)
    if save is not None:
        write(save, json.dumps(design_to_json(found), indent=1, allow_nan=False) + "\n")
    _print(
        as_json,
        lambda: design_json(name, found, reach, save),
        lambda: show.design_view(name, found, reach),
    )


@app.command()
def analyse(
    name: Annotated[
        str, typer.Argument(help="paper, auv, a scenario's name, or a system FILE.toml.")
    ],
    gain: Annotated[
        str | None,
        typer.Option(
            help='K, row by row, as in "[[0.6, -0.5]]"; else that of the scenario, or none.'
        ),
    ] = None,
    order: Annotated[
        int,
        typer.Option(help="0: Theorem 1. N: Bessel-Legendre, sharper, at exactly these delays."),
    ] = 0,
    gamma: Annotated[
        float | None, typer.Option(help="A bound to prove, instead of the least one.")
    ] = None,
    delays: Annotated[
        str | None, typer.Option(help="Delays instead of the system's own, as in 0.5,1.25 [s].")
    ] = None,
    max_delay: Annotated[
        bool,
        typer.Option(
            "--max-delay",
            help="The greatest delay for stability, or for --gamma: of the feedback, or else the "
            "first.",
        ),
    ] = False,
    delay_limit: Annotated[
        float, typer.Option(help="Where the search for a greatest delay ends [s].")
    ] = DELAY_LIMIT,
    save: Annotated[
        Path | None, typer.Option(help="Write the exact certificate here (JSON), if there is one.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Say what a given gain guarantees, or the system as it is, and prove it exactly.

    gamma is the least one that is certified, for every admissible uncertainty; without w and z
    it is stability. What is not certified may still be true: that is a result, with exit code 0.
    """
    named, own_gain = named_problem(name)
    system = named.system
    if delays is not None:
        system = with_delays(system, numbers("--delays", delays))
    K = own_gain if gain is None else gain_from(gain)
    reach: CertifiedDelay | None = None
    with _progress() as tell:
        tell(f"analysis of {name}", 0.0)
        if max_delay:
            which = next((j for j, delay in enumerate(system.delays) if delay.feedback), 0)
            reach = certified_delay(system, K, gamma, which=which, order=order, limit=delay_limit)
            found = reach.analysis
        else:
            found = make_analysis(system, K, gamma, order=order)
    saved = save if found.certified else None
    if saved is not None:
        write(saved, json.dumps(found.certificate, indent=1, allow_nan=False) + "\n")
    _print(
        as_json,
        lambda: analysis_json(name, found, reach, saved),
        lambda: show.analysis_view(name, found, reach),
    )


@certificate_app.command()
def check(
    file: Annotated[Path, typer.Argument(help="What --save of design or analyse wrote.")],
    *,
    as_json: JsonOption = False,
) -> None:
    """Prove a certificate's claim again from the file alone: no solver, no rounding.

    Exit code 0 if the claim is proved, 1 if it is not, 2 if the file is no certificate.
    """
    checked = check_certificate(read_certificate(file))
    _print(
        as_json,
        lambda: {
            "file": str(file),
            "valid": checked.valid,
            "reason": checked.reason,
            "claim": checked.claim,
        },
        lambda: show.certificate_view(str(file), checked),
    )
    if not checked.valid:
        raise typer.Exit(CheckFailedError.exit_code)


@app.command()
def run(
    name: Annotated[str, typer.Argument(help="A scenario's name, or FILE.toml.")],
    out: Annotated[Path | None, typer.Option(help="The trace (default: traces/NAME.mcap).")] = None,
    fmus: FmusOption = _FMUS,
    as_json: JsonOption = False,
) -> None:
    """Fly a scenario and write its trace.

    A run that diverges or ends in a limit cycle is done and says so (exit code 0); a
    component that fails ends it with exit code 4, and what was recorded stays.
    """
    loaded = load(name)
    trace = out or _TRACES / f"{loaded.name}.mcap"
    check_room(trace)
    with _progress() as tell:
        prepared = prepare(loaded, _hangar(fmus, loaded.folder), progress=tell)
        outcome = fly(prepared, trace, progress=tell)
    _print(as_json, outcome.to_json, lambda: show.outcome_view(outcome))
    if outcome.status == "failed":
        raise typer.Exit(4)


@trace_app.command()
def info(
    file: Annotated[Path, typer.Argument(help="A trace, finished or .partial, or any MCAP file.")],
    *,
    as_json: JsonOption = False,
) -> None:
    """Say what a trace holds: run, topics, links, result, content hash."""
    description = describe(file)
    _print(as_json, lambda: description, lambda: render(description))


@trace_app.command()
def rerun(
    file: Annotated[Path, typer.Argument(help="A trace written by cosim run.")],
    out: Annotated[Path | None, typer.Option(help="Keep the new trace here.")] = None,
    fmus: FmusOption = _FMUS,
    as_json: JsonOption = False,
) -> None:
    """Rebuild the run from the trace alone, fly it again, and compare (exit 1 if it differs)."""
    with _progress() as tell:
        result = run_again(file, _hangar(fmus), output=out, progress=tell)
    _print(as_json, result.to_json, lambda: show.rerun_view(result))
    if not result.identical:
        raise typer.Exit(CheckFailedError.exit_code)


def main() -> None:
    """Entry point: errors become messages and exit codes, never tracebacks."""
    as_json = "--json" in sys.argv[1:]
    try:
        code = app(standalone_mode=False) or 0
    except CosimError as error:
        _complain(error, error.exit_code, as_json=as_json)
        sys.exit(error.exit_code)
    except _UsageError as error:
        sys.exit(_misused(error, as_json=as_json))
    except BrokenPipeError:
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
    if code == _INTERRUPTED:
        _complain(CosimError("interrupted", hint=_LEFT_BEHIND), code, as_json=as_json)
    sys.exit(code)


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


def _print(as_json: bool, data: Callable[[], Any], view: Callable[[], Any]) -> None:  # noqa: FBT001
    if as_json:
        print(json.dumps(data(), indent=1, allow_nan=False))
    else:
        show.console().print(view())


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error for what takes longer than a moment; none without a terminal."""
    terminal = show.console(error=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,
    ) as bar:
        task = bar.add_task("", total=1.0)

        def tell(what: str, share: float) -> None:
            bar.update(task, description=what, completed=share)

        yield tell


def _hangar(fmus: Path, folder: Path | None = None) -> Hangar:
    return Hangar(root=fmus, folder=folder or Path.cwd())
