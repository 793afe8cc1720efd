"""Verbs about studies: list, check, run, show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.cli.arguments import names
from cosim.cli.common import FMUS, FmusOption, JsonOption, answer, progress
from cosim.cli.run import Flavour
from cosim.cli.study_view import checked_view, finished_view, studies_view, summary_view
from cosim.core import InputError, StoppedError
from cosim.study import (
    LoadedStudy,
    Plan,
    Study,
    boundary,
    builtin_studies,
    draw,
    draw_stability,
    execute_study,
    load_study,
    plan_of,
    pool_for,
    read_rows,
    read_table,
    summarise,
)

STUDIES = Path("studies")

study_app = typer.Typer(
    no_args_is_help=True,
    help="Fly one scenario thousands of times: grids, samples, seeds; on one core or a cluster.",
)

StudyArgument = Annotated[str, typer.Argument(help="A study's name, or FILE.toml.")]
FlavourOption = Annotated[
    Flavour,
    typer.Option(help="The built-in FMUs: C, built by this machine's compiler, or Python."),
]


@study_app.command("list")
def list_studies(*, as_json: JsonOption = False) -> None:
    """List the studies that come with the package."""
    rows = [{"name": name, "title": load_study(name).study.title} for name in builtin_studies()]
    answer(as_json, lambda: {"studies": rows}, lambda: studies_view(rows))


@study_app.command()
def check(
    name: StudyArgument,
    fmus: FmusOption = FMUS,
    flavour: FlavourOption = Flavour.native,
    as_json: JsonOption = False,
) -> None:
    """Say what a study would do: its axes, its metrics, the number of its runs; fly nothing.

    Example: cosim study check delay-margin
    """
    loaded = load_study(name)
    plan = _plan(loaded, fmus, flavour)
    data = {
        "study": loaded.name,
        "title": loaded.study.title,
        "scenario": loaded.base.name,
        "runs": plan.count,
        "axes": {a.column: list(a.places) for a in loaded.study.vary},
        "metrics": list(loaded.study.metrics),
        "first": _values(plan, 0),
        "last": _values(plan, plan.count - 1),
    }
    answer(as_json, lambda: data, lambda: checked_view(data))


@study_app.command()
def run(
    name: StudyArgument,
    out: Annotated[
        Path | None, typer.Option(help="The study's folder (default: studies/NAME).")
    ] = None,
    workers: Annotated[
        str,
        typer.Option(help="How many processes of this machine: 1 is this one; or 'all' cores."),
    ] = "1",
    scheduler: Annotated[
        str | None,
        typer.Option(help="Fly on the workers of this Dask scheduler instead: tcp://HOST:PORT."),
    ] = None,
    traces: Annotated[
        str | None,
        typer.Option(help="Keep the traces of: none, all, failed, 'worst:N by METRIC'."),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Throw away what the folder holds, and begin anew.")
    ] = False,
    fmus: FmusOption = FMUS,
    flavour: FlavourOption = Flavour.native,
    as_json: JsonOption = False,
) -> None:
    """Fly a study, or what is left of it, and write its table: results.parquet.

    The table is the same, bit for bit, whoever flies it. Interrupted, the same command goes
    on where it was: a run that is done is not flown again. A run that cannot be flown is in
    the table with its reason, and stops no other.

    Examples
    --------
    cosim study run delay-margin;
    cosim study run my-study.toml --workers all;
    cosim study run my-study.toml --scheduler tcp://10.0.0.5:8786
    --out /shared/mine --fmus /shared/fmus
    """
    loaded = load_study(name)
    if traces is not None:
        loaded = replace(loaded, study=_with_traces(loaded.study, traces))
    pool = pool_for(workers, scheduler)
    folder = out or STUDIES / loaded.name
    plan = _plan(loaded, fmus, flavour)
    try:
        with progress() as report_progress:
            done = execute_study(plan, folder, pool, fresh=fresh, progress=report_progress)
    except KeyboardInterrupt:
        there = len(read_rows(folder)) if folder.is_dir() else 0
        raise StoppedError(
            "interrupted",
            where=str(folder),
            got=f"{there} of {plan.count} runs are done, and kept",
            hint="the same command goes on",
        ) from None
    answer(as_json, done.to_json, lambda: finished_view(done))


@study_app.command()
def show(
    path: Annotated[Path, typer.Argument(help="A study's folder, or its results.parquet.")],
    by: Annotated[
        str | None,
        typer.Option(help="Axes to group by: A,B; 'all' for all runs together."),
    ] = None,
    confidence: Annotated[float, typer.Option(help="Of the intervals.")] = 0.95,
    bootstrap: Annotated[
        bool, typer.Option("--bootstrap", help="Intervals of means by bootstrap, not Student's t.")
    ] = False,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw to this .png, .svg or .pdf: the stability map of the study."),
    ] = None,
    metric: Annotated[
        str | None, typer.Option(help="Draw this metric instead, over the axes of --over.")
    ] = None,
    over: Annotated[
        str | None,
        typer.Option(help="One axis: a curve; 'A,B': a map; 'A,per,B': a curve per value of B."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Sum a study up: shares and means with their intervals, per group; and draw it.

    A study that is not finished is summed up as far as it is.

    Examples: cosim study show studies/delay-margin --picture margin.png;
    cosim study show studies/sea-states --by Hs;
    cosim study show studies/sea-states --metric error --over Hs --picture error.png
    """
    table, manifest = read_table(path)
    groups = None if by is None else [] if by == "all" else list(names("--by", by))
    found = summarise(table, manifest, groups, confidence=confidence, bootstrap=bootstrap)
    edge = boundary(table, manifest)
    if (metric is None) != (over is None) or (metric is not None and picture is None):
        raise InputError(
            "--metric, --over and --picture belong together",
            where="study show",
            hint="--metric gain --over delay --picture gain.png",
        )
    if picture is not None and metric is not None and over is not None:
        draw(table, manifest, picture, metric, list(names("--over", over)))
    elif picture is not None:
        draw_stability(table, manifest, picture)
    data = found.to_json() | {
        "stability": None if edge is None else edge.to_json(),
        "picture": None if picture is None else str(picture),
    }
    answer(as_json, lambda: data, lambda: summary_view(found, edge, picture))


def _plan(loaded: LoadedStudy, fmus: Path, flavour: Flavour) -> Plan:
    return plan_of(loaded.study, loaded.base, loaded.place, fmus=fmus, flavour=flavour.value)


def _values(plan: Plan, number: int) -> dict[str, Any]:
    axes = plan.job.study.vary
    return {a.column: v for a, v in zip(axes, plan.runner.points[number], strict=True)}


def _with_traces(study: Study, traces: str) -> Study:
    try:
        return Study.model_validate(study.model_dump(exclude_unset=True) | {"traces": traces})
    except ValueError as error:
        raise InputError(
            "not a choice of traces",
            where="--traces",
            expected="none, all, failed, or 'worst:N by METRIC'",
            got=repr(traces),
        ) from error
