"""Verbs that hand a trace to viewers: play, view."""

from __future__ import annotations

import json
import signal
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from rich.text import Text

from cosim.cli.common import JsonOption, answer
from cosim.cli.terminal import console
from cosim.trace import Player, view_in_rerun

FileArgument = Annotated[
    Path, typer.Argument(help="A trace, finished or .partial, or any MCAP file.")
]


def play(
    file: FileArgument,
    *,
    rate: Annotated[float, typer.Option(help="Recorded seconds per second.")] = 1.0,
    port: Annotated[int, typer.Option(help="On this machine alone; 0: any that is free.")] = 8765,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    start: Annotated[
        float, typer.Option(help="Where to begin, in seconds from the first message.")
    ] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Play a trace to Foxglove, or to any viewer that speaks its protocol.

    All channels are there from the beginning; it plays as soon as somebody subscribes. Play,
    pause, seek and speed are in the viewer's hands. It listens on this machine alone, until
    Ctrl-C.

    \b
    cosim trace play traces/auv-acoustic.mcap --rate 4
    cosim trace play traces/auv-acoustic.mcap --start 60 --loop --port 0
    """
    # told to stop is told to stop, by either signal, and also where a shell that put this into
    # the background has it ignore Ctrl-C
    before = {n: signal.signal(n, _interrupt) for n in (signal.SIGTERM, signal.SIGINT)}
    try:
        with (
            suppress(KeyboardInterrupt),
            Player(file, rate=rate, port=port, start_s=start, loop=loop) as player,
        ):
            _print_address(player, file, as_json=as_json)
            player.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def view(
    file: FileArgument,
    *,
    save: Annotated[
        Path | None, typer.Option(help="Write an .rrd file for later, and open nothing.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Open a trace in Rerun, laid out for the run: path, pose, states, thrust, age, log.

    The viewer runs on this machine, asks for nothing outside, and sends no usage figures.

    \b
    cosim trace view traces/auv-acoustic.mcap
    cosim trace view traces/auv-acoustic.mcap --save flight.rrd
    """
    viewed = view_in_rerun(file, save)
    answer(as_json, viewed.to_json, lambda: Text(viewed.text()))


def _print_address(player: Player, file: Path, *, as_json: bool) -> None:
    if as_json:
        data = {"trace": str(file), "url": player.url, "port": player.port, "topics": player.topics}
        print(json.dumps(data), flush=True)
        return
    console().print(
        Text.assemble(
            ("playing", "bold"),
            f" {file} at {player.url}, {len(player.topics)} topics\n"
            "in Foxglove: Open connection, Foxglove WebSocket, this address; here: Ctrl-C to end",
        )
    )


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
