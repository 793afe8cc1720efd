"""What the verbs share: options, progress, and one way to answer."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from cosim.cli.terminal import console
from cosim.fmu import DEFAULT_FLAVOUR
from cosim.scenario import FmuCache

FMUS = Path("fmus")
TRACES = Path("traces")

JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object and nothing else on standard output.")
]
FmusOption = Annotated[
    Path, typer.Option("--fmus", help="Folder of the FMUs; what is missing is built there.")
]

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change the scenario: a dotted key and a value as in TOML; may be repeated.",
    ),
]


def answer(as_json: bool, data: Callable[[], Any], view: Callable[[], Any]) -> None:  # noqa: FBT001
    """Print `data` as JSON, or `view` for people."""
    if as_json:
        print(json.dumps(data(), indent=1, allow_nan=False))
    else:
        console().print(view())


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error for what takes longer than a moment; none without a terminal."""
    terminal = console(error=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,
    ) as bar:
        task = bar.add_task("", total=1.0)
        doing = ""

        def report_progress(what: str, share: float) -> None:
            nonlocal doing
            if what != doing:  # the time that remains is estimated anew for each part
                doing = what
                bar.reset(task, total=1.0)
            bar.update(task, description=what, completed=share)

        yield report_progress


def make_fmu_cache(
    fmus: Path, folder: Path | None = None, flavour: str = DEFAULT_FLAVOUR
) -> FmuCache:
    """Where a run finds its FMUs."""
    return FmuCache(root=fmus, folder=folder or Path.cwd(), flavour=flavour)
