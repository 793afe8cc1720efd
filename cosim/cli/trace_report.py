"""The verb that makes a trace readable for people."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from cosim.cli.common import JsonOption, answer
from cosim.trace import Report, write_report

_STYLE = {"good": "green", "bad": "red", "open": "yellow"}


def report(
    file: Annotated[Path, typer.Argument(help="A trace, finished or .partial, or any MCAP file.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="The page (default: beside the trace, run.html of run.mcap)."
        ),
    ] = None,
    *,
    show: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write one HTML page of a trace: verdict, path, signals, links, provenance.

    The page stands alone: it needs no network and asks for none, so it can be mailed and kept.
    Of a run that went wrong the cause comes first.

    \b
    cosim trace report traces/auv-acoustic.mcap
    cosim trace report crashed.mcap.partial -o crashed.html --open
    """
    written = write_report(file, out)
    answer(as_json, written.to_json, lambda: _view(written))
    if show:
        webbrowser.open(written.output.absolute().as_uri())


def _view(written: Report) -> Text:
    text = Text.assemble(
        "report: ",
        (str(written.output), "bold"),
        f" ({written.bytes / 1e6:.1f} MB, {written.charts} charts)\nthe run: {written.status}",
    )
    if written.guarantee is not None:
        check = written.guarantee
        text.append(f"\n{check.what}", style=_STYLE[check.tone]).append(f": {check.why}")
    return text
