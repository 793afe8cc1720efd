"""The verb that writes a trace as tables."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from cosim.cli.common import JsonOption, answer, progress
from cosim.trace import WrittenTable, export as write_tables


class Format(enum.Enum):
    """What --to takes."""

    csv = "csv"
    parquet = "parquet"


def export(
    file: Annotated[Path, typer.Argument(help="A trace, or any MCAP file.")],
    to: Annotated[Format, typer.Option(help="CSV, or Parquet (extra tables).")] = Format.csv,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The folder; or the file, where there is one table."),
    ] = None,
    topics: Annotated[
        list[str] | None, typer.Option("--topic", help="This topic; may be repeated.")
    ] = None,
    signals: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            "--signals",
            help="This signal (plant.eta.x) or group (plant.eta); may be repeated.",
        ),
    ] = None,
    start: Annotated[float | None, typer.Option(help="From this time on, in s.")] = None,
    end: Annotated[float | None, typer.Option(help="Up to this time, in s.")] = None,
    wide: Annotated[
        bool,
        typer.Option("--wide", help="One table of all signals, as they were held at each instant."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    r"""Write what a trace holds as tables: CSV or Parquet.

    A table per topic, its rows as they were recorded: time_s of delivery, sent_s, sequence, the
    signals. With --wide one table: at each instant at which any of the signals has a row, every
    one has the value in force, the last one delivered up to then. What is absent is empty.
    Parquet carries units and descriptions with each column, and the run with the table.

    For example:

      cosim trace export traces/auv-acoustic.mcap --to parquet -o tables

      cosim trace export traces/auv-acoustic.mcap --signal plant.eta --signal plant.force --wide
      -o flight.csv
    """
    with progress() as report_progress:
        written = write_tables(
            file,
            out,
            to.value,
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
        "format": to.value,
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


def _view(written: list[WrittenTable]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("file", overflow="fold")
    table.add_column("rows", justify="right")
    table.add_column("columns", justify="right")
    for one in written:
        table.add_row(str(one.path), str(one.rows), str(len(one.columns)))
    return table
