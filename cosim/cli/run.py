"""Commands that run scenarios: demo, run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from cosim import master, scenario
from cosim.cli.arguments import number_or_text
from cosim.cli.common import (
    FMUS,
    TRACES,
    DetailsOption,
    FmusOption,
    JsonOption,
    RunFlavour,
    ScenarioArgument,
    SetOption,
    answer,
    output_folder,
    output_trace,
    progress,
)
from cosim.cli.runs import (
    interruptions_reported,
    make_fmu_cache,
    report_demo,
    report_outcome,
)
from cosim.cli.step_check_view import step_check_line, step_check_view
from cosim.cli.terminal import typed
from cosim.core import CheckFailedError, InputError, check_output
from cosim.fmu.export import DEFAULT_FLAVOUR


def demo(
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="Folder for the traces and the picture.", callback=output_folder
        ),
    ] = TRACES,
    fmus: FmusOption = FMUS,
    details: DetailsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Fly two designs with the same late position fixes and compare them in one picture.

    The same vehicle flies twice in the same sea. Its position fixes come over an acoustic link,
    seconds old and with losses in runs. The first flight has an observer and a gain designed for
    such fixes, the second a design for fresh fixes. The summary says whether the guarantee holds
    for each run, and what it does not cover. Traces and picture are written to the folder --out.

    \b
    cosim demo
    cosim demo --out demo
    """
    with progress() as report_progress, interruptions_reported():
        result = scenario.demonstrate(make_fmu_cache(fmus), out, report_progress)
    report_demo(result, as_json, details=details)


def run(
    name: ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File of the trace (default: traces/NAME.mcap).",
            callback=output_trace,
        ),
    ] = None,
    fmus: FmusOption = FMUS,
    engine: Annotated[
        Literal["auto", "kernel", "python"],
        typer.Option(
            help="What runs the loop: the kernel in C, or Python; the results are the same, "
            "bit for bit."
        ),
    ] = "auto",
    flavour: Annotated[
        RunFlavour,
        typer.Option(
            help="Flavour of the built-in FMUs: native (FMI 2.0 in C), native-fmi3 (FMI 3.0 in C), "
            "or python, whose slave can be edited. The results are the same, bit for bit, if all "
            "use the same C library."
        ),
    ] = DEFAULT_FLAVOUR,
    changed: SetOption = None,
    until: Annotated[
        str | None,
        typer.Option(help="Stop the run at this time, in seconds or with a unit: '2 min'."),
    ] = None,
    stop_when: Annotated[
        str | None,
        typer.Option(help="Stop the run when this condition becomes true: 'plant.eta.z > 5 m'."),
    ] = None,
    pace: Annotated[
        float | None,
        typer.Option(help="Slow the run down to this multiple of real time; 1 is real time."),
    ] = None,
    log_level: Annotated[
        Literal["debug", "info", "warning", "error"] | None,
        typer.Option(help="Record log messages of components from this level on (key log.level)."),
    ] = None,
    fsync: Annotated[
        bool,
        typer.Option("--fsync", help="Write each second of the trace through to the disk."),
    ] = False,
    check_step: Annotated[
        bool,
        typer.Option(
            "--check-step",
            help="Say whether the step is small enough: run at the communication step and "
            "at half of it, without a trace.",
        ),
    ] = False,
    check_tolerance: Annotated[
        float | None,
        typer.Option(
            help="With --check-step: exit with code 1 if an estimated error exceeds this "
            "share of a signal's range (without this option, the verdict uses 0.01)."
        ),
    ] = None,
    check_order: Annotated[
        bool,
        typer.Option(
            "--check-order",
            help="With --check-step: also run at a quarter of the step, and observe the order.",
        ),
    ] = False,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="End the run when it exceeds a limit: call, run, start, end (seconds, or "
            "'2 min') or memory ('2 GB'); none: no limit (keys of [limits]). May be "
            "repeated.",
        ),
    ] = None,
    no_supervise: Annotated[
        bool,
        typer.Option(
            "--no-supervise",
            help="Run the components in this process, which then ends if a component crashes.",
        ),
    ] = False,
    details: DetailsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a scenario and write its trace.

    Exit code 0: the run is done; the output says if it diverged, ended in a limit cycle or was
    stopped; 1: an assertion did not have the expected result, or the step is not small enough
    for --check-tolerance; 4: a component failed, crashed or exceeded a limit, and everything
    recorded until then is kept; 6: the run left a bound although every assumption of its proof was
    met (please report it); 130: interrupted by Ctrl-C.

    \b
    cosim run auv-acoustic
    cosim run auv-acoustic --set links.uplink.delay='400 ms' --set run.end=60
    cosim run auv-acoustic --stop-when 'abs(plant.eta.x) < 1 m and t > 10 s'
    cosim run auv-acoustic --until '10 s' --pace 20
    cosim run auv-acoustic --check-step
    cosim run mine.toml --limit call=30 --limit memory='2 GB'
    """
    settings = list(changed or ())
    if log_level is not None:
        settings.append(f'log.level="{log_level}"')
    stops: dict[str, dict[str, Any]] = {}
    if until is not None:
        stops[f"--until {until}"] = {"at": number_or_text(until)}
    if stop_when is not None:
        stops[f"--stop-when {stop_when!r}"] = {"when": stop_when}
    loaded = scenario.load(name, settings, stops)
    supervision = scenario.supervision_of(
        loaded.scenario, limit or (), supervise=False if no_supervise else None
    )
    if check_step:
        _refuse_together("--check-step", {"--out": out, "--pace": pace, "--fsync": fsync or None})
        cache = make_fmu_cache(fmus, loaded.folder, flavour)
        _check_step(
            *(loaded, cache, engine, check_tolerance, as_json),
            observe_order=check_order,
            supervision=supervision,
        )
        return
    if check_tolerance is not None or check_order:
        raise InputError(
            "this option belongs to --check-step",
            where="--check-order" if check_order else "--check-tolerance",
            hint="add --check-step",
        )
    trace = out or TRACES / f"{loaded.name}.mcap"
    check_output(trace)
    with progress() as report_progress, interruptions_reported():
        prepared = scenario.prepare(
            loaded, make_fmu_cache(fmus, loaded.folder, flavour), progress=report_progress
        )
        kept = None if pace is None else master.Pace(pace)
        outcome = scenario.execute_run(
            prepared,
            trace,
            progress=report_progress,
            engine=engine,
            pace=kept,
            fsync=fsync,
            supervision=supervision,
        )
    report_outcome(outcome, as_json, details=details)


def _refuse_together(option: str, others: Mapping[str, object]) -> None:
    """Refuse options that have no effect beside another one."""
    for other, value in others.items():
        if value is not None:
            raise InputError(
                f"{other} has no effect with {option}",
                where=option,
                expected="no trace, at full speed",
                hint=f"leave out {other}",
            )


def _check_step(
    loaded: scenario.LoadedScenario,
    fmu_cache: scenario.FmuCache,
    engine: master.EngineName,
    tolerance: float | None,
    as_json: bool,  # noqa: FBT001 - as `answer`
    *,
    observe_order: bool,
    supervision: scenario.Supervision,
) -> None:
    with progress() as report_progress, interruptions_reported():
        prepared = scenario.prepare(loaded, fmu_cache, progress=report_progress)
        check = scenario.check_step(
            prepared,
            tolerance=tolerance,
            observe_order=observe_order,
            progress=report_progress,
            engine=engine,
            supervision=supervision,
        )
    step, tones = check.suggested_step_s, {"yes": "good", "no": "bad"}
    answer(
        as_json,
        check.to_json,
        lambda: step_check_view(check),
        line=step_check_line(check),
        tone=tones.get(check.verdict, "open"),
        then=() if step is None else (typed("run", loaded.name, "--set", f"run.step={step:.2g}"),),
    )
    if "failed" in check.statuses:
        raise typer.Exit(4)
    if tolerance is not None and check.verdict != "yes":
        raise typer.Exit(CheckFailedError.exit_code)
