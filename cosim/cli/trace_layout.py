"""The command that writes the layout of a viewer: trace layout."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group
from rich.table import Column

from cosim.cli.common import (
    JsonOption,
    answer,
    output_file,
)
from cosim.cli.terminal import table
from cosim.core import counted
from cosim.trace.viewers import Viewer, WrittenLayout, write_layout


def layout(
    file: Annotated[Path, typer.Argument(help="A trace, or any MCAP file.")],
    viewer: Annotated[
        Viewer,
        typer.Option("--for", help="The viewer; Foxglove imports the layout of lichtblick."),
    ] = "lichtblick",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write (default: NAME.VIEWER.json or .xml beside FILE).",
            callback=output_file,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a layout with which a viewer shows a trace: scene, log, and plots with their units.

    The layout is made from the topics of the trace, so every path in it exists. Open the trace in
    the viewer first, then the layout.

    \b
    cosim trace layout traces/auv-survey.mcap --for lichtblick
    cosim trace layout traces/auv-survey.mcap --for plotjuggler -o auv.xml
    """
    written = write_layout(file, viewer, out)
    answer(
        as_json,
        written.to_json,
        lambda: _view(written),
        line=f"layout: {written.path}, {counted(len(written.tabs), 'tab')} of curves",
        tone="good",
    )


def _view(written: WrittenLayout) -> Group:
    rows = ((title, str(count)) for title, count in written.tabs.items())
    lines = [f"left out, for want of room: {written.left_out} curves"] if written.left_out else []
    return Group(table((Column("tab", overflow="fold"), ">curves"), rows), *lines)
