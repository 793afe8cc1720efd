"""The command that writes a trace as tables, or as a bag of ROS 2: trace export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Group
from rich.table import Column, Table

from cosim.cli.common import (
    JsonOption,
    answer,
    output_file_or_folder,
    progress,
)
from cosim.cli.terminal import table
from cosim.core import InputError, counted
from cosim.trace import export as write_tables
from cosim.trace.exports import WrittenTable
from cosim.trace.ros2 import WrittenBag, export_bag

Format = Literal["csv", "parquet", "mat", "ros2"]


def export(
    file: Annotated[Path, typer.Argument(help="A trace, or any MCAP file.")],
    to: Annotated[
        Format | None,
        typer.Option(
            help="Format of the tables (default: by the extension of --out, else csv); "
            "parquet needs the extra tables. ros2: one bag of messages in place of "
            "tables (needs the extra ros2)."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder to write to; or the file, if there is one: a table, a .mat file, "
            "or a bag (.mcap).",
            callback=output_file_or_folder,
        ),
    ] = None,
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="Export only this topic; may be repeated.")
    ] = None,
    signals: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            "--signals",
            help="Export only this signal (plant.eta.x) or group (plant.eta); may be repeated.",
        ),
    ] = None,
    start: Annotated[
        float | None, typer.Option(help="Leave out rows before this time, in s.")
    ] = None,
    end: Annotated[float | None, typer.Option(help="Leave out rows after this time, in s.")] = None,
    wide: Annotated[
        bool,
        typer.Option("--wide", help="Write one table of all signals, with sample and hold."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the signals of a trace as CSV or Parquet tables, a MATLAB file or a ROS 2 bag.

    Without --wide there is one table per topic, with its rows as recorded: time_s (delivered),
    sent_s (sent), sequence, and the signals. With --wide there is one table, with a row for each
    instant at which any of the signals was recorded: it has the value in force of every signal,
    which is the last one delivered. Missing values are empty. Parquet files contain the unit and
    description of each column, and the description of the run.

    A .mat file (format 5) has a struct for each table: the columns, under names that MATLAB
    accepts, with their original names, units and descriptions. In a .mat file a table can have at
    most 2 GiB, and is in memory while it is written.

    With --to ros2 there is one MCAP file of the profile ros2: poses, path, frames, odometry and the
    log as messages of geometry_msgs, nav_msgs, tf2_msgs and rcl_interfaces, and every other signal
    as a topic of std_msgs.

    \b
    cosim trace export traces/auv-survey.mcap --to parquet -o tables
    cosim trace export traces/auv-survey.mcap --signal plant.eta --wide -o path.csv
    cosim trace export traces/auv-survey.mcap --to ros2
    cosim trace export traces/auv-survey.mcap -o run.mat
    """
    chosen = to or _format_of(out)
    if chosen == "ros2":
        _write_bag(file, out, topics, (start, end), wide=wide, signals=signals, as_json=as_json)
        return
    with progress() as report_progress:
        written = write_tables(
            file,
            out,
            chosen,
            topics=topics,
            signals=signals,
            start=start,
            end=end,
            wide=wide,
            report_progress=report_progress,
        )
    places = dict.fromkeys(one.path for one in written)
    where = next(iter(places)) if len(places) == 1 else written[0].path.parent
    answer(
        as_json,
        lambda: _json(file, chosen, written),
        lambda: _view(written),
        line=f"written: {counted(len(written), 'table')} to {where}",
        tone="good",
    )


def _write_bag(
    file: Path,
    out: Path | None,
    topics: list[str] | None,
    window: tuple[float | None, float | None],
    *,
    wide: bool,
    signals: list[str] | None,
    as_json: bool,
) -> None:
    if wide or signals:
        raise InputError(
            "a bag has topics, no tables",
            where="--wide" if wide else "--signal",
            expected="--topic to choose what is written with --to ros2",
        )
    start, end = window
    with progress() as report_progress:
        bag = export_bag(
            file, out, topics=topics, start=start, end=end, report_progress=report_progress
        )
    answer(
        as_json,
        lambda: _bag_json(file, bag),
        lambda: _bag_view(bag),
        line=f"bag: {bag.path}, {counted(len(bag.topics), 'topic')}",
        tone="good",
        then=(f"ros2 bag play {bag.path}",),
    )


def _format_of(out: Path | None) -> Format:
    """Return the format by the end of a file's name; csv of any other."""
    formats: dict[str, Format] = {".parquet": "parquet", ".mat": "mat", ".mcap": "ros2"}
    return formats.get("" if out is None else out.suffix.lower(), "csv")


def _json(file: Path, to: Format, written: list[WrittenTable]) -> dict[str, Any]:
    return {
        "trace": str(file),
        "format": to,
        "files": [
            {
                "path": str(one.path),
                "topic": one.topic,
                "rows": one.rows,
                "columns": list(one.columns),
            }
            for one in written
        ],
    }


def _bag_json(file: Path, bag: WrittenBag) -> dict[str, Any]:
    return {
        "trace": str(file),
        "format": "ros2",
        "path": str(bag.path),
        "topics": dict(bag.topics),
        "left_out": list(bag.left_out),
    }


def _bag_view(bag: WrittenBag) -> Group:
    rows = ((topic, str(count)) for topic, count in bag.topics.items())
    lines = [f"left out, no message of ROS 2 for it: {', '.join(bag.left_out)}"]
    lines = lines if bag.left_out else []
    return Group(table((Column("topic", overflow="fold"), ">messages"), rows), *lines)


def _view(written: list[WrittenTable]) -> Table:
    return table(
        (Column("file", overflow="fold"), ">rows", ">columns"),
        ((str(one.path), str(one.rows), str(len(one.columns))) for one in written),
    )
