"""Commands for studies: list, check, run, repeat, show, report, sensitivity."""

from __future__ import annotations

import json
import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.text import Text

from cosim import scenario, study as studies
from cosim.cli.arguments import names, numbers
from cosim.cli.common import (
    FMUS,
    TRACES,
    FmusOption,
    JsonOption,
    RunFlavour,
    answer,
    built_in_or_file,
    completed_from,
    output_file,
    output_folder,
    output_trace,
    progress,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.runs import interruptions_reported, report_outcome
from cosim.cli.study_view import (
    checked_line,
    checked_view,
    finished_line,
    finished_view,
    merged_line,
    merged_view,
    rare_line,
    rare_view,
    sensitivity_line,
    sensitivity_view,
    show_commands,
    stopped_line,
    stopped_view,
    study_report_view,
    summary_view,
    unfinished,
)
from cosim.cli.terminal import titles_table, typed
from cosim.core import InputError, LossError, StoppedError, check_output
from cosim.fmu.export import DEFAULT_FLAVOUR

STUDIES = Path("studies")

study_app = HelpTyper(
    help="Run one scenario many times: over grids, random samples or seeds; on cores or a cluster.",
)

StudyArgument = Annotated[str, built_in_or_file("study")]
FlavourOption = Annotated[
    RunFlavour,
    typer.Option(help="Flavour of the built-in FMUs: native, native-fmi3, or python."),
]

LimitOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=VALUE",
        help="End a run when it exceeds a limit: call, run, start, end (seconds, or '2 "
        "min') or memory ('2 GB'); none: no limit. Default of run: 50 times as long "
        "as the first run took, at least 60 s. May be repeated.",
    ),
]


@study_app.command("list")
def list_studies(*, as_json: JsonOption = False) -> None:
    """List the built-in studies.

    \b
    cosim study list
    """
    rows = [
        {"name": name, "title": studies.load_study(name).study.title}
        for name in studies.builtin_studies()
    ]
    answer(
        as_json,
        lambda: {"studies": rows},
        lambda: titles_table("study", "title", rows),
        line=f"{len(rows)} studies are built in",
        then=("cosim study check delay-margin", "cosim study run delay-margin"),
    )


@study_app.command()
def schema(*, as_json: JsonOption = False) -> None:
    """Print the JSON Schema of studies, for editors that complete and check TOML.

    \b
    cosim study schema > study.schema.json
    """
    del as_json  # the output is JSON with or without it
    print(json.dumps(studies.study_schema(), indent=1))


@study_app.command()
def check(
    name: StudyArgument,
    fmus: FmusOption = FMUS,
    flavour: FlavourOption = DEFAULT_FLAVOUR,
    as_json: JsonOption = False,
) -> None:
    """Check a study and show its axes, its metrics and the number of its runs; run nothing.

    \b
    cosim study check delay-margin
    """
    loaded = studies.load_study(name)
    plan, study = _plan(loaded, fmus, flavour), loaded.study
    studies.check_runs(plan)
    data = {
        "study": loaded.name,
        "title": loaded.study.title,
        "scenario": loaded.base.name,
        "runs": plan.count,
        "runs_are": "at most" if study.stop else "at least" if study.rare else "exactly",
        "axes": {a.column: list(a.places) for a in loaded.study.vary},
        "metrics": list(loaded.study.metrics),
        "first": _values(plan, 0),
        "last": _values(plan, plan.count - 1),
    }
    answer(
        as_json,
        lambda: data,
        lambda: checked_view(data),
        line=checked_line(data),
        tone="good",
        then=(typed("study run", name),),
    )


@study_app.command()
def run(
    name: StudyArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the results (default: studies/NAME).",
            callback=output_folder,
        ),
    ] = None,
    workers: Annotated[
        str,
        typer.Option(
            help="Number of processes on this machine; 1: only this one; all: one per core."
        ),
    ] = "1",
    scheduler: Annotated[
        str | None,
        typer.Option(help="Run on the workers of this Dask scheduler instead: tcp://HOST:PORT."),
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of sampled points, instead of the study's; a study that was run with "
            "fewer is extended, and keeps its runs.",
        ),
    ] = None,
    traces: Annotated[
        str | None,
        typer.Option(
            help="Keep the traces of these runs: none, all, failed, or 'worst:N by METRIC'."
        ),
    ] = None,
    limit: LimitOption = None,
    runs: Annotated[
        str | None,
        typer.Option(
            metavar="FIRST:END",
            help="Run only this part of the study's runs, which count from 0; run END is not in "
            "it. `cosim study merge` joins the folders of parts.",
        ),
    ] = None,
    time_limit: Annotated[
        str,
        typer.Option(
            help="Begin no more runs after this time (seconds, or '2 h'); exit code 3 if "
            "runs are left; the same command then continues."
        ),
    ] = "none",
    wait_for_workers: Annotated[
        str,
        typer.Option(
            help="With --scheduler: how long to wait while there are no workers; none: for ever."
        ),
    ] = "10 min",
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Delete the results in the folder and start again.")
    ] = False,
    fmus: FmusOption = FMUS,
    flavour: FlavourOption = DEFAULT_FLAVOUR,
    as_json: JsonOption = False,
) -> None:
    """Run a study, or the rest of it, and write the table of its results: results.parquet.

    The table is the same, bit for bit, with any number of workers. If the command is interrupted,
    the same command continues: runs that are done are not repeated. A run that fails is in the
    table with the reason, and the other runs continue.

    \b
    cosim study run delay-margin
    cosim study run delay-margin --workers all
    cosim study run delay-margin --runs 0:20 --out part-1
    cosim study run sea-states --scheduler tcp://10.0.0.5:8786
    """
    loaded = studies.load_study(name)
    if traces is not None:
        expected = "none, all, failed, or 'worst:N by METRIC'"
        loaded = replace(loaded, study=_with_option(loaded.study, "traces", traces, expected))
    if samples is not None:
        expected = f"1 to {studies.MAX_RUNS}"
        loaded = replace(loaded, study=_with_option(loaded.study, "samples", samples, expected))
    wait_s = scenario.time_limit(wait_for_workers, "--wait-for-workers")
    pool = studies.pool_for(workers, scheduler, wait_s)
    folder = out or STUDIES / loaded.name
    plan = _plan(loaded, fmus, flavour)
    try:
        with progress() as report_progress:
            done = studies.execute_study(
                plan,
                folder,
                pool,
                fresh=fresh,
                limits=limit or (),
                time_limit_s=scenario.time_limit(time_limit, "--time-limit"),
                runs=None if runs is None else plan.part(runs),
                progress=report_progress,
            )
    except KeyboardInterrupt:
        there = 0
        if folder.is_dir():
            with studies.read_rows(folder) as rows:
                there = len(rows)
        raise StoppedError(
            "interrupted",
            where=str(folder),
            got=f"{there} of {plan.count} runs are done and kept",
            hint="the same command continues",
        ) from None
    answer(
        as_json,
        done.to_json,
        lambda: finished_view(name, done),
        line=finished_line(loaded.name, done),
        tone="open" if done.incomplete or done.runs < done.count else "good",
        then=show_commands(done.folder),
    )


@study_app.command()
def merge(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders of one study, each with a part of its runs.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder of the whole study.", callback=output_folder)
    ],
    as_json: JsonOption = False,
) -> None:
    """Merge parts of one study, executed in different places, into one folder.

    Folders of different studies are refused: the message names what differs. A run that is in
    several folders must have the same results in each, bit for bit. Once all runs are there, the
    table is written; it is the same as that of a study executed in one place.

    \b
    cosim study run delay-margin --runs 0:20 --out part-1
    cosim study run delay-margin --runs 20:25 --out part-2
    cosim study merge part-1 part-2 --out whole
    """
    found = studies.merge_studies(folders, out)
    answer(
        as_json,
        found.to_json,
        lambda: merged_view(found),
        line=merged_line(found),
        tone="good" if found.runs == found.count else "open",
        then=show_commands(found.folder),
    )


@study_app.command()
def repeat(
    name: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="Name of a built-in study, FILE.toml, or the folder of its results.",
            autocompletion=completed_from("study"),
        ),
    ],
    number: Annotated[int, typer.Argument(help="Number of the run, counted from 0.")],
    out: Annotated[
        Path | None,
        typer.Option(
            help="File of the trace (default: traces/STUDY-run-NUMBER.mcap).", callback=output_trace
        ),
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Folder of the study (default: studies/NAME); in a study of a rare event, "
            "later runs depend on the results there.",
        ),
    ] = None,
    limit: LimitOption = None,
    fmus: FmusOption = FMUS,
    flavour: FlavourOption = DEFAULT_FLAVOUR,
    as_json: JsonOption = False,
) -> None:
    """Execute one run of a study alone, with a trace, as `cosim run` does.

    Given the folder of the results, the command uses the study as it was run, with its samples; if
    FMUs or the scenario have changed since then, nothing is run.

    \b
    cosim study repeat delay-margin 17
    cosim study repeat studies/delay-margin 17
    cosim trace report traces/delay-margin-run-17.mcap
    """
    loaded = studies.load_study(name)
    plan = _plan(loaded, fmus, flavour)
    studies.check_unchanged(plan, loaded)
    trace = out or TRACES / f"{loaded.name}-run-{number}.mcap"
    check_output(trace)
    folder = results or (STUDIES / loaded.name if loaded.digest is None else Path(name))
    with interruptions_reported():
        outcome = studies.repeat_run(
            plan,
            number,
            trace,
            limits=limit or (),
            results=folder if results is not None or folder.is_dir() else None,
        )
    report_outcome(outcome, as_json)


@study_app.command()
def show(
    path: Annotated[Path, typer.Argument(help="Folder of a study, or its results.parquet.")],
    by: Annotated[
        str | None,
        typer.Option(help="Group the runs by these axes: A,B; all: one group of all runs."),
    ] = None,
    confidence: Annotated[float, typer.Option(help="Confidence level of the intervals.")] = 0.95,
    bootstrap: Annotated[
        bool,
        typer.Option("--bootstrap", help="Bootstrap the intervals of means (not Student's t)."),
    ] = False,
    quantiles: Annotated[
        str | None,
        typer.Option(help="Quantiles of the metrics, with intervals: 0.05,0.95."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="Draw the study to this .png, .svg or .pdf file, in the way that fits it: the "
            "stability boundary, a map or a curve over its grid, sensitivity, a distribution.",
            callback=output_file,
        ),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(
            help="Kind of the picture: boundary, curve, map, distribution, scatter, convergence, "
            "sensitivity or correlations."
        ),
    ] = None,
    metric: Annotated[
        str | None, typer.Option(help="Metric of the picture (default: the first one).")
    ] = None,
    over: Annotated[
        str | None,
        typer.Option(
            help="Axes of the picture. A: a curve; A,B: a map; A,per,B: a curve per value of B."
        ),
    ] = None,
    details: Annotated[
        bool,
        typer.Option("--details", help="Show every metric of every group, with its intervals."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show the answers of a study, with shares and means per group, and draw it.

    Intervals are given for runs that are drawn from one distribution. Values of a grid are chosen,
    not drawn, so a group that combines runs of several values has no interval.

    For a study that is not finished, the summary covers the runs that are done. For a study with
    `stop` it says what was reached, for one with `rare` it gives the probability.

    \b
    cosim study show studies/delay-margin --picture margin.png
    cosim study show studies/delay-margin --by delay --quantiles 0.05,0.95
    cosim study show studies/delay-margin --picture g.png --kind scatter --metric age --over delay
    """
    whole, manifest = studies.read_table(path)
    stopped = studies.stopping_of(whole, manifest)
    rare = studies.rare_estimate(whole, manifest)
    table, manifest = studies.plain_sample(whole, manifest)
    groups = None if by is None else [] if by == "all" else list(names("--by", by))
    found = studies.summarise(
        table,
        manifest,
        groups,
        confidence=confidence,
        bootstrap=bootstrap,
        quantiles=[] if quantiles is None else numbers("--quantiles", quantiles),
    )
    edge = studies.boundary(table, manifest)
    if picture is None and any(option is not None for option in (kind, metric, over)):
        raise InputError(
            "--kind, --metric and --over are of a picture",
            where="study show",
            hint="--picture gain.png --metric gain --over delay",
        )
    if picture is not None:
        axes = [] if over is None else list(names("--over", over))
        studies.draw_study(table, manifest, picture, kind, metric, axes)
    data = found.to_json() | {
        "stability": None if edge is None else edge.to_json(),
        "picture": None if picture is None else str(picture),
    }
    event = manifest["study"].get("rare")
    if stopped is not None:
        data["stop"] = stopped.to_json()
    if event is not None:
        runs = {"runs": whole.num_rows, "complete": rare is not None}
        data["rare"] = event | runs | ({} if rare is None else rare.to_json(confidence))
    details = details or quantiles is not None
    columns = studies.columns_of(table, manifest)
    answers, pooling = studies.answers_of(columns, confidence), studies.pooling_words(columns)
    data |= {"answers": answers, "pooling": pooling}

    def view() -> Group:
        first = [] if stopped is None else [stopped_view(stopped)]
        first += [] if event is None else [rare_view(event, rare, whole.num_rows)]
        drawn = [] if picture is None else [Text(f"picture: {picture}")]
        rest = answers if first else answers[1:]
        rest_of_it = summary_view(found, edge, answers=answers, pooling=pooling, details=details)
        return Group(*first, *map(Text, rest), Text(found.title, "dim"), *drawn, rest_of_it)

    line = answers[0] if answers else "no run has a value"
    if stopped is not None:
        line = stopped_line(stopped)
    elif event is not None:
        line = rare_line(event, rare, confidence)
    more = () if details else (typed("study show", path, "--details"),)
    answer(
        as_json,
        lambda: data,
        view,
        line=f"{line}{unfinished(found)}",
        then=(typed("study report", path), *more),
    )


@study_app.command()
def report(
    path: Annotated[Path, typer.Argument(help="Folder of a study, or its results.parquet.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write (default: report.html in the folder).",
            callback=output_file,
        ),
    ] = None,
    confidence: Annotated[float, typer.Option(help="Confidence level of the intervals.")] = 0.95,
    *,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write one HTML page about a study: how its runs ended, its metrics, what they depend on.

    The page contains everything it shows and needs no network; the worst runs link to their traces
    beside it. For a study that is not finished, the page has the runs that are done.

    Exit code 3: the page is written, but lines of the run log cannot be read.

    \b
    cosim study report studies/delay-margin
    cosim study report studies/delay-margin -o margin.html --open
    """
    written = studies.write_study_report(path, out, confidence=confidence)
    size = f"{written.bytes / 1e6:.2g} MB, {written.metrics} metrics, {written.charts} charts"
    answer(
        as_json,
        written.to_json,
        lambda: study_report_view(written),
        line=f"report: {written.output} ({size})",
    )
    if show:
        webbrowser.open(written.output.absolute().as_uri())
    if written.unread:
        raise typer.Exit(LossError.exit_code)


@study_app.command("sensitivity")
def show_sensitivity(
    path: Annotated[Path, typer.Argument(help="Folder of a study, or its results.parquet.")],
    metric: Annotated[str, typer.Argument(help="Metric of the study.")],
    confidence: Annotated[float, typer.Option(help="Confidence level of the intervals.")] = 0.95,
    as_json: JsonOption = False,
) -> None:
    """Show how much of a metric's variance is due to each axis, of a study of kind "saltelli".

    \b
    cosim study sensitivity studies/my-study error
    """
    table, manifest = studies.read_table(path)
    found = studies.sensitivity(table, manifest, metric, confidence=confidence)
    answer(as_json, found.to_json, lambda: sensitivity_view(found), line=sensitivity_line(found))


def _plan(loaded: studies.LoadedStudy, fmus: Path, flavour: RunFlavour) -> studies.Plan:
    return studies.plan_of(loaded.study, loaded.base, loaded.place, fmus=fmus, flavour=flavour)


def _values(plan: studies.Plan, number: int) -> dict[str, Any]:
    axes = plan.job.study.vary
    return {a.column: v for a, v in zip(axes, plan.runner.points[number], strict=True)}


def _with_option(study: studies.Study, key: str, value: Any, expected: str) -> studies.Study:
    """Return the study with another value of a key, which an option of this name gives."""
    try:
        return studies.Study.model_validate(study.model_dump(exclude_unset=True) | {key: value})
    except ValueError as error:
        raise InputError(
            f"not a valid choice of {key}", where=f"--{key}", expected=expected, got=repr(value)
        ) from error
