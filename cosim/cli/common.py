"""Options, progress and output that the commands share."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.text import Text

from cosim.cli.progress_lines import ProgressLines
from cosim.cli.terminal import TONES, commands, console
from cosim.core import NotAchievableError, check_output, check_output_folder, reported_to

FMUS = Path("fmus")
TRACES = Path("traces")

RunFlavour = Literal["native", "native-fmi3", "python"]
"""Choices of --flavour for runs."""

DetailsOption = Annotated[
    bool, typer.Option("--details", help="Show everything behind the answer.")
]
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object, and nothing else, on standard output."),
]
FmusOption = Annotated[
    Path, typer.Option("--fmus", help="Folder of the FMUs; missing FMUs are built there.")
]


def output_file(path: Path | None) -> Path | None:
    """Check, while options are read, where a file is to go; a device or a pipe will do."""
    if path is not None:
        check_output(path, streams=True)
    return path


def output_trace(path: Path | None) -> Path | None:
    """Check where a trace is to go: no device, since it grows under another name."""
    if path is not None:
        check_output(path)
    return path


def output_folder(path: Path | None) -> Path | None:
    """Check the folder for all that a command makes, there or not."""
    if path is not None:
        check_output_folder(path)
    return path


def output_file_or_folder(path: Path | None) -> Path | None:
    """Check where one file or several are to go."""
    is_folder = path is not None and os.path.isdir(path)  # noqa: PTH112 - Path raises
    return output_folder(path) if is_folder else output_file(path)


def completed_from(room: str) -> Callable[[str], list[str]]:
    """Return what completes the names of built-in scenarios or studies, without loading them."""

    def names(incomplete: str) -> list[str]:
        library = resources.files("cosim").joinpath(room, "library")
        files = (entry.name for entry in library.iterdir())
        stems = (name.removesuffix(".toml") for name in files if name.endswith(".toml"))
        return sorted(stem for stem in stems if stem.startswith(incomplete))

    return names


def built_in_or_file(room: str) -> Any:
    """Return the argument that names a built-in scenario or study, or a file."""
    return typer.Argument(
        metavar=room.upper(),
        help=f"Name of a built-in {room}, or FILE.toml.",
        autocompletion=completed_from(room),
    )


ScenarioArgument = Annotated[str, built_in_or_file("scenario")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change one key of the scenario (dotted key, TOML value); may be repeated.",
    ),
]

_REFRESH_S = 0.1


def answer(
    as_json: bool,  # noqa: FBT001
    data: Callable[[], Mapping[str, Any]],
    view: Callable[[], Any] | None = None,
    *,
    line: str,
    tone: str = "",
    then: Sequence[str] = (),
) -> None:
    """Print what a command found: the answer, what to do next, then what the answer rests on.

    data : what `--json` prints behind the answer, which is its first key.
    view : what the answer rests on, for people; None: the answer says it all.
    line : the answer, one sentence.
    tone : "good", "open" or "bad": whether it is what was asked for; "" where nothing was.
    then : commands that make sense next, as they are typed.
    """
    if as_json:
        print(json.dumps({"answer": line, **data()}, indent=1, allow_nan=False))
        return
    screen = console()
    screen.print(Text(line, style=f"bold {TONES[tone]}"), crop=False)
    if then:
        screen.print(commands(*then), crop=False, soft_wrap=True)
    if view is not None:
        screen.print(view(), crop=False)


@contextmanager
def alternatives_named(delays: str | None) -> Iterator[None]:
    """Name the options for what can be had in place of a refused design.

    delays : the option for the delays that can be had; None: there is none.
    """
    try:
        yield
    except NotAchievableError as error:
        options = [] if error.gamma is None else [f"--gamma {error.gamma:g}"]
        if error.delays is not None and delays is not None:
            options.append(f"{delays} {','.join(map(repr, error.delays))}")
        if options:
            error.hint = f"{error.hint}: {(' ' if error.together else ' or ').join(options)}"
        raise


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Show progress on standard error; yield what updates it.

    A bar on a terminal; elsewhere a plain line now and then.
    """
    terminal = console(error=True)
    if not terminal.is_terminal:
        lines = ProgressLines()
        with reported_to(lines, lines.go_on):
            yield lines
        return
    from rich.progress import (  # noqa: PLC0415 - only where it is seen
        BarColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        auto_refresh=False,  # by a thread, with which no process can be forked from this one
    ) as bar:
        task = bar.add_task("", total=1.0)
        doing, refreshed_at = "", 0.0

        def report_progress(what: str, share: float) -> None:
            nonlocal doing, refreshed_at
            if what != doing:  # the remaining time is estimated anew for each part
                doing = what
                bar.reset(task, total=1.0)
            bar.update(task, description=what, completed=share)
            if (now := time.monotonic()) - refreshed_at > _REFRESH_S:
                refreshed_at = now
                bar.refresh()

        with reported_to(report_progress):
            yield report_progress
