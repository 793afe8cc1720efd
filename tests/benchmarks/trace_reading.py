"""What reading a trace costs, by its size: peak memory and seconds of each command.

A run of two components and two links, of noise that hardly compresses, is written in each size.
`python -m tests.benchmarks.trace_reading --mb 500 1000 2000 --json` prints {"reading": {MB:
{COMMAND: {"peak_mb", "seconds"}}}}; `--topics 1000 5000` measures by the number of topics instead.
`play` is measured up to its first message, and then for ten seconds at a high rate.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from rich.table import Table

from tests.benchmarks._show import show
from tests.recorded_runs import write_run, write_topics

_STEPS_PER_MB = 4150
COMMANDS = ("info", "verify", "report", "csv", "parquet", "wide", "diff", "recover", "play")


def measured(arguments: list[str], *, ends: bool = True) -> dict[str, float]:
    """Return peak memory [MB] and seconds of a command, and its exit code."""
    began = time.perf_counter()
    with subprocess.Popen(  # noqa: S603 - ourselves
        [sys.executable, "-m", "cosim", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        found: dict[str, float] = {}
        assert process.stdout is not None
        if not ends:
            found["first_message_s"] = _listen(json.loads(process.stdout.readline()), began)
            process.terminate()
        process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    peak = round(usage.ru_maxrss / 1024, 1)
    seconds = round(time.perf_counter() - began, 2)
    return {"peak_mb": peak, "seconds": seconds, "exit": process.returncode, **found}


def _listen(address: dict[str, Any], began: float) -> float:
    """Subscribe to everything for ten seconds; return when the first message came [s]."""
    from websockets.sync.client import connect  # noqa: PLC0415 - only `play` needs it

    first = 0.0
    with connect(
        address["url"], subprotocols=["foxglove.sdk.v1"], max_size=None, max_queue=None
    ) as socket:
        threading.Timer(10.0, socket.close).start()
        try:
            while True:
                received = socket.recv()
                if isinstance(received, bytes):
                    if received[0] == 1 and not first:
                        first = time.perf_counter() - began
                    continue
                data = json.loads(received)
                if data["op"] == "advertise":
                    wanted = [
                        {"id": i, "channelId": c["id"]} for i, c in enumerate(data["channels"])
                    ]
                    socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        except Exception:  # noqa: BLE001 - closed by the timer
            return round(first, 2)


def every_command(trace: Path, other: Path, folder: Path) -> dict[str, list[str]]:
    """Return the arguments of every command measured."""
    out = str(folder / "out")
    export = ["trace", "export", str(trace), "-o"]
    return {
        "info": ["trace", "info", str(trace), "--json"],
        "verify": ["trace", "verify", str(trace), "--json"],
        "report": ["trace", "report", str(trace), "-o", f"{out}.html"],
        "csv": [*export, f"{out}-csv", "--to", "csv"],
        "parquet": [*export, f"{out}-parquet", "--to", "parquet"],
        "wide": [*export, f"{out}.wide.parquet", "--to", "parquet", "--wide"],
        "diff": ["trace", "diff", str(trace), str(other), "--json"],
        "recover": ["trace", "recover", str(trace) + ".cut", "-o", f"{out}.mcap", "--force"],
        "play": ["trace", "play", str(trace), "--port", "0", "--rate", "100", "--json"],
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--mb", type=int, nargs="*", default=[50])
    parser.add_argument("--topics", type=int, nargs="*", default=[])
    parser.add_argument("--commands", nargs="*", default=list(COMMANDS))
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--json", action="store_true", help="print JSON alone")
    options = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    sizes = [("topics", n) for n in options.topics] or [("MB", n) for n in options.mb]
    for unit, size in sizes:
        with tempfile.TemporaryDirectory(dir=options.folder) as name:
            folder = Path(name)
            trace, other = folder / "a.mcap", folder / "b.mcap"
            if unit == "MB":
                write_run(trace, size * _STEPS_PER_MB)
            else:
                write_topics(trace, size)
            if "diff" in options.commands:
                if unit == "MB":
                    steps = size * _STEPS_PER_MB
                    write_run(other, steps, changed_at=steps // 2)
                else:
                    write_topics(other, size, rows=90)
            if "recover" in options.commands:
                cut = Path(f"{trace}.cut")
                shutil.copyfile(trace, cut)
                os.truncate(cut, trace.stat().st_size - 1000)
            key = f"{size} {unit}, {trace.stat().st_size / 1e6:.0f} MB"
            found[key] = {}
            commands = every_command(trace, other, folder)
            for command in options.commands:
                found[key][command] = measured(commands[command], ends=command != "play")
                print(key, command, found[key][command], file=sys.stderr, flush=True)
    view = Table("trace", "command", "peak MB", "seconds", "exit")
    for key, by_command in found.items():
        for command, one in by_command.items():
            view.add_row(key, command, *(str(one[k]) for k in ("peak_mb", "seconds", "exit")))
    show(view, {"reading": found})


if __name__ == "__main__":
    main()
