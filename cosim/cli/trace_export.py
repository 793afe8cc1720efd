"""The command that writes a trace as tables: trace export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Group
from rich.table import Table

from cosim.cli.common import JsonOption, answer, progress
from cosim.core import InputError
from cosim.trace import WrittenBag, WrittenTable, export as write_tables, export_bag

Format = Literal["csv", "parquet", "ros2"]


def export(
    file: Annotated[Path, typer.Argument(help="A trace, or any MCAP file.")],
    to: Annotated[
        Format,
        typer.Option(
            help="csv or parquet (needs the extra tables): tables; ros2: one bag of messages."
        ),
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder to write to; or the file, if there is one table."),
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
    """Write the signals of a trace as CSV or Parquet tables, or as a bag of ROS 2.

    Without --wide there is one table per topic, with its rows as recorded: time_s (delivered),
    sent_s (sent), sequence, and the signals. With --wide there is one table: at each instant at
    which any of the signals was recorded, it has the value in force of every signal, which is the
    last one delivered. Missing values are empty. Parquet files contain the unit and description
    of each column, and the description of the run.

    With --to ros2 there is one MCAP file of the profile ros2: poses, path, frames, odometry and the
    log as messages of geometry_msgs, nav_msgs, tf2_msgs and rcl_interfaces, and every other signal
    as a topic of std_msgs.

    \b
    cosim trace export traces/auv-acoustic.mcap --to parquet -o tables
    cosim trace export traces/auv-acoustic.mcap --signal plant.eta --wide -o path.csv
    cosim trace export traces/auv-acoustic.mcap --to ros2
    """
    if to == "ros2":
        if wide or signals:
            raise InputError(
                "a bag has topics, no tables",
                where="--wide" if wide else "--signal",
                expected="--topic to choose what is written with --to ros2",
            )
        with progress() as report_progress:
            bag = export_bag(
                file, out, topics=topics, start=start, end=end, report_progress=report_progress
            )
        answer(as_json, lambda: _bag_json(file, bag), lambda: _bag_view(bag))
        return
    with progress() as report_progress:
        written = write_tables(
            file,
            out,
            to,
            topics=topics,
            signals=signals,
            start=start,
            end=end,
            wide=wide,
            report_progress=report_progress,
        )
    answer(as_json, lambda: _json(file, to, written), lambda: _view(written))


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
    table = Table(box=None, pad_edge=False)
    table.add_column("topic", overflow="fold")
    table.add_column("messages", justify="right")
    for topic, count in bag.topics.items():
        table.add_row(topic, str(count))
    lines = [f"bag: {bag.path}"]
    if bag.left_out:
        lines.append(f"left out, no message of ROS 2 for it: {', '.join(bag.left_out)}")
    return Group(table, *lines)


def _view(written: list[WrittenTable]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("file", overflow="fold")
    table.add_column("rows", justify="right")
    table.add_column("columns", justify="right")
    for one in written:
        table.add_row(str(one.path), str(one.rows), str(len(one.columns)))
    return table
