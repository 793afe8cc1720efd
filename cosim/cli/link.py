"""The commands for recorded links: link record, link show, link fit, link verdict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from cosim import core, hinf, recordings
from cosim.cli.arguments import write
from cosim.cli.common import (
    JsonOption,
    answer,
    output_file,
    progress,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.link_fit_view import fit_json, fit_line, fit_view
from cosim.cli.link_verdict_view import verdict_json, verdict_line, verdict_view
from cosim.cli.link_view import (
    read_json,
    read_lines,
    read_view,
    record_json,
    show_json,
    show_view,
)
from cosim.cli.log_options import option_words, with_log_options
from cosim.cli.terminal import typed
from cosim.core import CheckFailedError, InputError, counted
from cosim.network import LogFormat, Recording

link_app = HelpTyper(
    help="Record links from traces, show what became of their messages, fit models, and judge "
    "links by a proof."
)

FileArgument = Annotated[
    Path,
    typer.Argument(help="A log of messages (text or Parquet), a trace, or another MCAP file."),
]
NodeOption = Annotated[
    str | None, typer.Option("--node", help="Only this link of a file with several.")
]
PictureOption = Annotated[
    Path | None,
    typer.Option(
        help="Also draw it to this .png, .svg or .pdf file (needs the extra plot).",
        callback=output_file,
    ),
]


@link_app.command()
@with_log_options
def record(
    file: FileArgument,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="CSV file to write.", callback=output_file)
    ],
    link: Annotated[
        str | None, typer.Option("--link", help="Only this link (default: every packet link).")
    ] = None,
    as_json: JsonOption = False,
    *,
    log_format: LogFormat,
) -> None:
    """Write what became of each message of a link: sent, delivered or lost.

    A link replays the CSV file, which is in seconds, with its key `recording`. In an MCAP file that
    is not a trace of a run, each topic is a link: the publish time is the time of sending, the log
    time that of arrival, and a gap in the sequence numbers is a loss. The options below describe
    how a log is written.

    \b
    cosim link record traces/auv-acoustic.mcap --link uplink -o uplink.csv
    cosim link record modem.log --unit ms -o uplink.csv
    """
    read = read_logs(file, link, log_format)
    found = _recordings(read)
    recordings.write_recordings(out, found)
    answer(
        as_json,
        lambda: record_json(file, out, read),
        lambda: read_view(file, read),
        line=f"written: {out}, {counted(len(found), 'link')}",
        tone="good",
        then=(typed("link show", out), typed("link fit", out)),
    )


@link_app.command()
@with_log_options
def show(
    file: FileArgument,
    node: NodeOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
    *,
    log_format: LogFormat,
) -> None:
    """Show what a recorded link was like: losses, their runs, delays, ages and outages.

    The first line says what was read; questions about anything that looks wrong in it are printed
    on standard error.

    \b
    cosim link show uplink.csv
    cosim link show modem.log --sent tx_time --received rx_time --unit ms
    cosim link show traces/auv-acoustic.mcap --node uplink --picture uplink.png
    """
    if picture is not None:
        core.pyplot()
    read = read_logs(file, node, log_format)
    found = _recordings(read)
    if picture is not None:
        recordings.draw_recordings(found, picture)
    described = {name: recordings.statistics_of(each) for name, each in found.items()}
    answer(
        as_json,
        lambda: show_json(file, described, picture) | read_json(read),
        lambda: show_view(file, described, picture),
        line="; ".join(read_lines(file, read)),
        then=(typed("link fit", file, *option_words(log_format)),),
    )


@link_app.command()
@with_log_options
def fit(
    file: FileArgument,
    node: NodeOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Also write the [links.NAME] as TOML.", callback=output_file
        ),
    ] = None,
    name: Annotated[str, typer.Option(help="NAME of the link, if the file gives none.")] = "uplink",
    states: Annotated[
        int, typer.Option(help="Hidden states of the largest chain that is tried, from 2.")
    ] = 3,
    as_json: JsonOption = False,
    *,
    log_format: LogFormat,
) -> None:
    """Fit the models of a link to what was recorded, and say whether one fits.

    Losses: independent, Gilbert (a chain seen in the losses), Gilbert-Elliott, and chains of
    more hidden states, by maximum likelihood. Delays: constant, or with uniform, exponential or
    normal jitter. They are fitted to the first two thirds of the messages and compared with the
    last third: the likelihood, the share of losses, the lengths of runs, the distribution of the
    delays, and whether each delay is independent of the one before. If the file has distances or
    sizes, the dependence on them is fitted as well. The result is a link of a scenario.

    Exit code 1: no model fits; the output names the statistics that reject it.

    \b
    cosim link fit uplink.csv
    cosim link fit modem.log --unit ms
    cosim link fit traces/auv-acoustic.mcap --node uplink --states 3 -o link.toml
    """
    read, found = read_logs(file, node, log_format), {}
    with progress() as report_progress:
        for number, (each, recording) in enumerate(_recordings(read).items()):
            report_progress("fitting", number / len(read))
            found[each or name] = recordings.fit_link(recording, states)
    if out is not None:
        tomls = [each.toml(link) for link, each in found.items()]
        write(out, "\n".join(tomls))
    refused = any(each.refusals for each in found.values())
    answer(
        as_json,
        lambda: fit_json(file, found, out) | read_json(read),
        lambda: read_view(file, read, fit_view(found, out)),
        line=fit_line(found),
        tone="bad" if refused else "good",
    )
    if refused:
        raise typer.Exit(CheckFailedError.exit_code)


@link_app.command()
@with_log_options
def verdict(
    file: FileArgument,
    design: Annotated[
        Path, typer.Option("--design", help="A design or an analysis with --outages (JSON).")
    ],
    other: Annotated[
        float,
        typer.Option(
            help="Further age of a measurement beyond that of its message [s]: the delay "
            "of the command, the receiver's step."
        ),
    ] = 0.0,
    node: NodeOption = None,
    as_json: JsonOption = False,
    *,
    log_format: LogFormat,
) -> None:
    """Say what a proof across outages guarantees over a recorded link.

    For each link the output gives its losses, the share of the time that the proof needs the link
    up and the share that it was up, the share of the time in which gamma held, when gamma was
    suspended and regained, and by how much V can have grown. It also gives two tests of mean-square
    stability, for a chain of two hidden states fitted to the losses; they are about the chain and
    not about this recording.

    Exit code 1: a link was up for less time than needed.

    \b
    cosim link verdict uplink.csv --design gain.json --other 0.1
    """
    read = read_logs(file, node, log_format)
    proved = certified(design)
    found = {}
    with progress() as report_progress:
        for number, (name, recording) in enumerate(_recordings(read).items()):
            report_progress("judging", number / len(read))
            found[name] = recordings.outage_verdict(recording, proved, other)
    holds = all(each.holds for each in found.values())
    answer(
        as_json,
        lambda: verdict_json(file, design, found) | read_json(read),
        lambda: read_view(file, read, verdict_view(file, found)),
        line=verdict_line(file, found),
        tone="good" if holds else "bad",
    )
    if not holds:
        raise typer.Exit(CheckFailedError.exit_code)


def certified(path: Path) -> hinf.Result:
    """Return the design in a file; of an analysis, its gain and what is proved of it.

    Raises
    ------
    InputError : no such file, no proof, or one that does not hold.
    """
    found = hinf.synthesis.Result.from_certificate(
        hinf.certificate.read_certificate(path), where=str(path)
    )
    if found.observer is not None:
        raise InputError(
            "nothing is proved across outages of a loop with an observer",
            where=str(path),
            expected="the design of a state feedback, with --outages",
            hint="an outage cuts its measurements one by one: no proof covers that",
        )
    return found


def read_logs(
    file: Path, node: str | None, log_format: LogFormat
) -> dict[str, recordings.ReadRecording]:
    """Return the recordings of a file, or of one node; ask about what looks wrong.

    Raises
    ------
    InputError : as `read_recordings`, or an unknown node.
    """
    found = recordings.read_log(file, log_format)
    if node is not None:
        name, read = recordings.one_of(found, file, node)
        found = {name: read}
    for name, read in found.items():
        read.plausibility.ask(file, name)
    return found


def _recordings(read: Mapping[str, recordings.ReadRecording]) -> dict[str, Recording]:
    return {name: each.recording for name, each in read.items()}
