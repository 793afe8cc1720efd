"""Commands for one trace: info, rerun, report, recover, verify, play, view."""

from __future__ import annotations

import json
import signal
import webbrowser
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from rich.text import Text

from cosim import trace as traces
from cosim.cli.common import (
    DetailsOption,
    JsonOption,
    answer,
    output_file,
    progress,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.terminal import console, typed
from cosim.cli.trace_view import (
    comparison_view,
    recovery_line,
    recovery_view,
    report_view,
    verification_line,
    verification_view,
)
from cosim.cli.verbs import TraceVerbs
from cosim.core import CheckFailedError, LossError, printable
from cosim.trace import live, outcome, report as reports

trace_app = HelpTyper(
    cls=TraceVerbs,
    help="Read, verify, recover, compare, show, export and rerun recorded traces.",
)

FileArgument = Annotated[
    Path, typer.Argument(help="A trace (finished or .partial), or any MCAP file.")
]


@trace_app.command()
def info(
    file: FileArgument,
    *,
    hashed: Annotated[
        bool | None,
        typer.Option(
            "--hash/--no-hash",
            help="Compute the content hash, which reads the whole file (default: for files "
            "up to 64 MiB).",
        ),
    ] = None,
    details: DetailsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show what a trace contains: run, topics, links, result, content hash.

    \b
    cosim trace info traces/auv-survey.mcap
    """
    description = traces.describe(file, hashed=hashed)
    ended = outcome.ended_of(description)
    answer(
        as_json,
        lambda: description,
        lambda: traces.render(description, details=details),
        line=ended.what,
        tone=ended.tone,
        then=(
            typed("trace report", file),
            *(() if details else (typed("trace info", file, "--details"),)),
        ),
    )


@trace_app.command()
def report(
    file: FileArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write (default: run.html beside the trace run.mcap).",
            callback=output_file,
        ),
    ] = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="OTHER",
            help="Show this trace beside FILE: outcomes, figures, overlaid signals and "
            "their difference (default file: run-other.html).",
        ),
    ] = None,
    *,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write one HTML page about a trace: status, guarantee, path, signals, links, provenance.

    The page contains everything it shows and needs no network, so it can be mailed and archived.
    After a failed run it begins with the cause. With --compare it shows two traces side by side;
    unlike that of trace diff, the exit code does not say whether they differ.

    \b
    cosim trace report traces/auv-survey.mcap
    cosim trace report traces/auv-survey.mcap -o run.html --open
    cosim trace report traces/auv-survey.mcap --compare traces/auv-survey-naive.mcap
    """
    if compare is None:
        written = reports.write_report(file, out)
        output = written.output
        answer(
            as_json,
            written.to_json,
            lambda: report_view(written),
            line=f"report: {output} ({written.bytes / 1e6:.1f} MB, {written.charts} charts)",
        )
    else:
        both = reports.write_comparison(file, compare, out)
        output = both.output
        answer(
            as_json,
            both.to_json,
            lambda: comparison_view(both),
            line=f"report: {output} ({both.bytes / 1e6:.1f} MB, {both.charts} charts)",
        )
    if show:
        webbrowser.open(output.absolute().as_uri())


@trace_app.command()
def recover(
    file: Annotated[
        Path, typer.Argument(help="A .partial trace, or any MCAP file that is cut off or damaged.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write (default: NAME.recovered.mcap beside FILE).",
            callback=output_file,
        ),
    ] = None,
    *,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite an output file that exists.")
    ] = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Leave out everything from damaged chunks: all that is kept is as it was "
            "recorded.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a complete trace from what a crash left, and report what was lost.

    Every message, metadata record and attachment that can be read is kept. Data from a damaged
    chunk may have wrong values: they are marked in the record cosim.recovered, and info, report and
    verify say so; --strict leaves them out. The original file is not changed.

    Exit code 0: nothing was lost; 3: something was lost, is suspect, or may have been lost, since
    a file without its end does not show what was still to come.

    \b
    cosim trace recover traces/auv-survey.mcap.partial
    cosim trace recover traces/auv-survey.mcap.partial -o mended.mcap --strict
    """
    with progress() as report_progress:
        result = traces.recover(file, out, force=force, strict=strict, progress=report_progress)
    answer(
        as_json,
        result.to_json,
        lambda: recovery_view(result),
        line=recovery_line(result),
        tone="open" if result.lost else "good",
        then=(typed("trace info", result.output), typed("trace report", result.output)),
    )
    if result.lost:
        raise typer.Exit(LossError.exit_code)


@trace_app.command()
def verify(
    file: FileArgument,
    fmus: Annotated[
        Path | None,
        typer.Option("--fmus", help="Folder in which the FMUs of the run are looked up by hash."),
    ] = None,
    *,
    details: DetailsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Check that a trace is complete, unchanged and consistent.

    It checks structure, checksums and indexes; that cosim.run comes first and cosim.result last;
    and the hashes of the files that the trace names. For links it checks that every message was
    sent by its sender, delivered at most once, never early and in the link's order, and that the
    counts agree with the result. For files of other tools it checks the structure alone.

    Exit code 0: all checks pass; 1: a check fails; 3: no check fails, but the file is cut off or
    has no result.

    \b
    cosim trace verify traces/auv-survey.mcap
    cosim trace verify traces/auv-survey.mcap --fmus fmus --json
    """
    found = traces.verify(file, fmus)
    incomplete = found.verdict == "incomplete"
    answer(
        as_json,
        found.to_json,
        lambda: verification_view(found, details=details),
        line=verification_line(found),
        tone={"ok": "good", "failed": "bad"}.get(found.verdict, "open"),
        then=(typed("trace recover", file),) if incomplete else (),
    )
    if found.verdict != "ok":
        failed = found.verdict == "failed"
        raise typer.Exit(CheckFailedError.exit_code if failed else LossError.exit_code)


@trace_app.command("cite")
def cite_verb(file: FileArgument, *, as_json: JsonOption = False) -> None:
    """Write how to cite a run: a paragraph for a methods section, and BibTeX.

    Both are made from what the trace says about its run: software, FMUs, step, seed, links,
    certificate, outcome and content hash.

    \b
    cosim trace cite traces/auv-survey.mcap
    cosim trace cite traces/auv-survey.mcap --json
    """
    found = traces.cite(file)
    # as it is pasted: not wrapped, and nothing before it
    text = f"{found.methods}\n\n{found.bibtex}"
    print(json.dumps(found.to_json(), indent=1) if as_json else printable(text))


@trace_app.command()
def play(
    file: FileArgument,
    *,
    rate: Annotated[
        float, typer.Option(help="Speed of playback: recorded seconds per second.")
    ] = 1.0,
    port: Annotated[
        int, typer.Option(help="Port to listen on, on this machine only; 0: any free port.")
    ] = 8765,
    loop: Annotated[bool, typer.Option("--loop", help="Start again at the end.")] = False,
    start: Annotated[
        float, typer.Option(help="Start this many seconds after the first message.")
    ] = 0.0,
    origins: Annotated[
        list[str] | None,
        typer.Option(
            "--origin",
            help="Web page that may play the trace, besides Foxglove: "
            "http://localhost:8080. May be repeated.",
        ),
    ] = None,
    token: Annotated[
        str | None, typer.Option(help="Token in the address (default: a new one each time).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Play a trace in Foxglove, or in any viewer that uses its protocol.

    All channels are announced at once, and playback starts when a viewer subscribes. The viewer
    controls play, pause, seek and speed. The server listens on this machine only, until Ctrl-C.
    It serves clients that have the token in its address, and only web pages that are allowed. The
    protocol has one time per message: publish times and sequence numbers are not sent.

    \b
    cosim trace play traces/auv-survey.mcap --rate 4
    cosim trace play traces/auv-survey.mcap --start 60 --loop --port 0
    """
    # both signals end it, also where a shell that started this in the background ignores Ctrl-C
    before = {n: signal.signal(n, _interrupt) for n in (signal.SIGTERM, signal.SIGINT)}
    try:
        with (
            suppress(KeyboardInterrupt),
            live.Player(
                file,
                rate=rate,
                port=port,
                start_s=start,
                loop=loop,
                origins=origins or (),
                token=token,
            ) as player,
        ):
            _print_address(player, file, as_json=as_json)
            player.wait()
        if player.damage:
            raise LossError(
                "parts of the trace were not played",
                where=str(file),
                got="; ".join(player.damage[:3]),
                hint="cosim trace recover makes a whole trace of the rest",
            )
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@trace_app.command()
def view(
    file: FileArgument,
    *,
    save: Annotated[
        Path | None,
        typer.Option(
            help="Write an .rrd file instead of opening the viewer.", callback=output_file
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show a trace in Rerun: path, pose, states, thrust, age, log.

    The viewer runs on this machine, needs no network, and sends no usage statistics.

    \b
    cosim trace view traces/auv-survey.mcap
    cosim trace view traces/auv-survey.mcap --save run.rrd
    """
    viewed = live.view_in_rerun(file, save)
    line, _, rest = viewed.text().partition("\n")
    answer(as_json, viewed.to_json, (lambda: Text(rest)) if rest else None, line=line)


def _print_address(player: live.Player, file: Path, *, as_json: bool) -> None:
    if as_json:
        data = {
            "trace": str(file),
            "url": player.url,
            "port": player.port,
            "topics": player.topics,
            "not_sent": ["publish time", "sequence number"],
        }
        print(json.dumps(data), flush=True)
        return
    console().print(
        Text.assemble(
            ("playing", "bold"),
            f" {file} at {player.url}, {len(player.topics)} topics\n"
            "in Foxglove: Open connection, Foxglove WebSocket, this whole address; Ctrl-C here "
            "ends it\nnot sent: publish times and sequence numbers, which the protocol lacks",
        )
    )


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
