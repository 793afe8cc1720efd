"""What a trace loses when its process is killed (kill -9), by wall clock and in rows.

A child writes rows and says of each, once it has handed it to the writer, which it was and
when. It is killed at a random moment, the `.partial` recovered, and what the official reader
finds in it compared with what the child had said. A third of the children each

* write a row every few milliseconds (`steady`);
* write hundreds at a time (`blocks`);
* write some and then compute for long, writing nothing (`long step`).

`python -m tests.benchmarks.kill [KILLS] [--json]`: 200 kills by default.
"""

from __future__ import annotations

import json
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rich.console import Console
from rich.table import Table

from cosim.trace import recover

INTERVAL_S = 1.0
KILLS = 200
AT_ONCE = 6
MODES = ("steady", "blocks", "long step")

CHILD = """
import os, sys, time
import numpy as np
from cosim.trace import Attachment, Rows, Signal, TraceWriter

path, mode, pause = sys.argv[1], sys.argv[2], float(sys.argv[3])
note = Attachment("note", "text/plain", b"x" * 1000)
writer = TraceWriter(path, run={"mode": mode}, attachments=[note], flush_interval_s=INTERVAL)
topic = writer.add_topic("/x", [Signal(f"x[{i}]") for i in range(5)], schema_name="t.X")
count, size = 0, 400 if mode == "blocks" else 1
while True:
    rows = np.arange(count, count + size)
    writer.write_rows([Rows(topic, rows, np.outer(rows, np.ones(5)))])
    count += size
    os.write(1, b"%d %.6f\\n" % (count, time.monotonic()))
    time.sleep(60 if mode == "long step" and count == 50 else pause)
""".replace("INTERVAL", str(INTERVAL_S))


@dataclass(frozen=True)
class Loss:
    """One kill.

    Attributes
    ----------
    written, kept : rows handed to the writer, rows recovered.
    seconds : from the moment at which the first row that is lost was handed over to the kill;
        0 when nothing is lost.
    unused_bytes : bytes of the file that were no whole record.
    """

    mode: str
    written: int
    kept: int
    seconds: float
    unused_bytes: int


def one_kill(number: int, folder: Path) -> Loss:
    """Start a child, kill it, compare."""
    draw = random.Random(number)  # noqa: S311 - to be repeatable
    mode = MODES[number % len(MODES)]
    path = folder / f"{number}.mcap"
    pause = draw.choice([0.002, 0.005, 0.02]) * (3 if mode == "blocks" else 1)
    with subprocess.Popen(  # noqa: S603 - the script above
        [sys.executable, "-c", CHILD, str(path), mode, str(pause)], stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        first = child.stdout.readline()
        time.sleep(draw.uniform(0.0, 3.0 * INTERVAL_S))
        killed = time.monotonic()
        child.kill()
        lines = [first, *child.stdout.read().splitlines()]
    words = [line.split() for line in lines if len(line.split()) == 2]
    written = int(words[-1][0])
    result = recover(path.with_name(path.name + ".partial"))
    kept = _rows(result.output)
    lost = [float(when) for count, when in words if int(count) > kept]
    return Loss(mode, written, kept, max(0.0, killed - lost[0]) if lost else 0.0, result.lost_bytes)


def _rows(path: Path) -> int:
    """How many rows there are, which must be the first ones, in order, and right."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        names = [record.name for record in reader.iter_metadata()]
        notes = [attachment.name for attachment in reader.iter_attachments()]
        found = [m for _, _, m in reader.iter_messages(log_time_order=False)]
    if names != ["cosim.run", "cosim.recovered"] or notes != ["note"]:
        raise SystemExit(f"{path}: {names}, {notes}")
    for k, message in enumerate(found):
        values = np.frombuffer(message.data, np.dtype([("tag", "u1"), ("value", "<f8")]))["value"]
        if message.log_time != k or (values != k).any():
            raise SystemExit(f"{path}: row {k} is another one")
    return len(found)


def kills(numbers: Sequence[int], tell: Callable[[str], None] = lambda _: None) -> Sequence[Loss]:
    """Many, some at once: their children mostly wait."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE) as pool:
        found = []
        for loss in pool.map(lambda number: one_kill(number, Path(folder)), numbers):
            found.append(loss)
            tell(f"{len(found)} of {len(numbers)} kills")
    return found


def main() -> None:
    """Kill, print."""
    numbers = [int(argument) for argument in sys.argv[1:] if argument.isdecimal()]
    console = Console(stderr=True)
    with console.status("") as status:
        found = kills(range(numbers[0] if numbers else KILLS), status.update)
    if "--json" in sys.argv:
        print(json.dumps({"interval_s": INTERVAL_S, "kills": [asdict(one) for one in found]}))
        return
    view = Table(title=f"lost by kill -9, flush interval {INTERVAL_S:g} s", title_justify="left")
    view.add_column("mode", no_wrap=True)
    for name in ("kills", "rows", "with loss", "rows lost", "most", "s lost", "most", "bytes"):
        view.add_column(name, justify="right")
    for mode in (*MODES, "all"):
        some = [one for one in found if mode in (one.mode, "all")]
        rows = [max(one.written - one.kept, 0) for one in some]
        seconds = [one.seconds for one in some]
        if some:
            view.add_row(
                mode,
                str(len(some)),
                str(sum(one.written for one in some)),
                str(sum(1 for lost in rows if lost)),
                f"{statistics.median(rows):g}",
                str(max(rows)),
                f"{statistics.median(seconds):.3f}",
                f"{max(seconds):.3f}",
                str(max(one.unused_bytes for one in some)),
            )
    view.caption = "lost: median and most, per kill; bytes: most that were no whole record"
    Console().print(view)
    if max(one.seconds for one in found) > INTERVAL_S:
        raise SystemExit("more than the interval was lost")


if __name__ == "__main__":
    main()
