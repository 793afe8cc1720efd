"""What a master costs per communication step, in one run on one machine.

Two tiny FMUs in C, N signals each way, a step of 1 ms, held inputs (Jacobi). Variants:

* c_bound: a loop in C for these two FMUs alone; nothing is recorded;
* compiled, python_engine: this project's engines, no link, every signal recorded in memory;
* compiled_links_recorded: packet links with jitter and loss both ways, recorded in memory;
* compiled_links_mcap: the same, with the trace on disk;
* fmpy_per_signal, fmpy_batched: the loop that a user writes with fmpy, nothing recorded;
* peers, where they are installed.

`python -m tests.benchmarks.loop --json` prints {"us_per_step": {VARIANT: {"1": x, ...}}}.
"""

from __future__ import annotations

import ctypes
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave
from rich.console import Console
from rich.table import Table

from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    EngineName,
    Link,
    Observer,
    System,
    TraceRecorder,
    make_timetable,
    simulate,
)
from cosim.master.wiring import Station
from cosim.network import Jitter, PacketLink
from cosim.trace import TraceWriter

if __package__:
    from tests.benchmarks.tiny_fmu import tiny_fmu
else:
    from tiny_fmu import tiny_fmu

SIGNALS = (1, 6, 20)
STEP = 1e-3
REPEATS = 5
_MS = 1_000_000


def pair(fmu: Path) -> list[FMU2Slave]:
    """Two initialised slaves by fmpy."""
    model = fmpy.read_model_description(str(fmu))
    slaves = []
    for name in ("a", "b"):
        slave = FMU2Slave(
            guid=model.guid,
            unzipDirectory=fmpy.extract(str(fmu)),
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=name,
        )
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves.append(slave)
    return slaves


def c_bound(fmu: Path, n: int) -> float:
    """Seconds per step of the loop in C."""
    a, b = pair(fmu)
    steps = 2_000_000
    references = (ctypes.c_uint * (2 * n))(*range(2 * n))
    out, into = ctypes.addressof(references), ctypes.addressof(references) + 4 * n

    def address(slave: FMU2Slave, name: str) -> int | None:
        return ctypes.cast(slave.dll[name], ctypes.c_void_p).value

    calls = ("fmi2GetReal", "fmi2SetReal", "fmi2DoStep")
    arguments: list[Any] = []
    for slave in (a, b):
        arguments += [ctypes.c_void_p(address(slave, name)) for name in calls]
        arguments.append(ctypes.c_void_p(slave.component))
    arguments += [ctypes.c_void_p(out), ctypes.c_void_p(into), ctypes.c_double(STEP)]
    loop = a.dll["bare_loop"]
    began = time.perf_counter()
    failed = loop(*arguments, ctypes.c_long(steps))
    spent = time.perf_counter() - began
    if failed:
        raise SystemExit("the bare loop failed")
    return spent / steps


def by_fmpy(fmu: Path, n: int, *, batched: bool) -> float:
    """Seconds per step of a loop over fmpy's own methods."""
    a, b = pair(fmu)
    steps = 20_000
    out, into = list(range(n)), list(range(n, 2 * n))
    began = time.perf_counter()
    for k in range(steps):
        if batched:
            ya, yb = a.getReal(out), b.getReal(out)
            b.setReal(into, ya)
            a.setReal(into, yb)
        else:
            ya = [a.getReal([i])[0] for i in out]
            yb = [b.getReal([i])[0] for i in out]
            for i, x, y in zip(into, ya, yb, strict=True):
                b.setReal([i], [x])
                a.setReal([i], [y])
        for slave in (a, b):
            slave.doStep(k * STEP, STEP)
    return (time.perf_counter() - began) / steps


def ours(
    fmu: Path, n: int, *, engine: EngineName, steps: int, links: bool = False, trace: bool = False
) -> float:
    """Seconds per step of this project's master."""
    described = describe_fmu(fmu)
    ways = {}
    if links:
        ways = {
            name: PacketLink(
                name, 10 * _MS, 0, 30 * _MS, Jitter("uniform", width_ns=20 * _MS), loss=0.05
            )
            for name in ("up", "down")
        }
    channels: dict[str, Link] = dict(ways)
    connections = [
        Connection(Endpoint(s, f"x[{i}]"), Endpoint(t, f"u[{i}]"), link if links else None)
        for s, t, link in (("a", "b", "up"), ("b", "a", "down"))
        for i in range(1, n + 1)
    ]
    # on the grid, so that a step is a step
    timetable = make_timetable(channels, _MS, _MS * steps, "grid")
    components = {name: Component(described) for name in ("a", "b")}
    system = System(components, connections, channels, {}, timetable, 1e9)
    watch = Stopwatch()
    if not trace:
        simulate(system, [watch], engine=engine)
        return watch.seconds / steps
    with (
        tempfile.TemporaryDirectory() as scratch,
        TraceWriter(Path(scratch, "run.mcap"), run={}) as writer,
    ):
        simulate(system, [TraceRecorder(writer, system), watch], engine=engine)
        writer.finish({})
        return (time.perf_counter() - watch.began) / steps


class Stopwatch(Observer):
    """From the first point, all slaves initialised, to the last."""

    began = 0.0
    seconds = 0.0

    def begin(self, stations: Sequence[Station]) -> None:
        """Start."""
        # memory is handed out when it is first touched: not the master's cost
        for station in stations:
            station.rows[:] = station.rows.copy()
        self.began = time.perf_counter()

    def span(self, first: int, last: int) -> None:
        """Stop, so far."""
        del first, last
        self.seconds = time.perf_counter() - self.began

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Look on."""


VARIANTS: dict[str, Callable[[Path, int], float]] = {
    "c_bound": c_bound,
    "compiled": partial(ours, engine="compiled", steps=400_000),
    "compiled_links_recorded": partial(ours, engine="compiled", steps=400_000, links=True),
    "compiled_links_mcap": partial(ours, engine="compiled", steps=40_000, links=True, trace=True),
    "python_engine": partial(ours, engine="python", steps=40_000),
    "fmpy_batched": partial(by_fmpy, batched=True),
    "fmpy_per_signal": partial(by_fmpy, batched=False),
}


def main() -> None:
    """Measure, print."""
    seconds: dict[str, dict[int, list[float]]] = {v: {n: [] for n in SIGNALS} for v in VARIANTS}
    with tempfile.TemporaryDirectory() as scratch:
        fmus = {n: tiny_fmu(n, Path(scratch)) for n in SIGNALS}
        for _ in range(REPEATS):  # interleaved: a slow spell of the machine hits all alike
            for n in SIGNALS:
                for variant, case in VARIANTS.items():
                    seconds[variant][n].append(case(fmus[n], n))
    table = {
        variant: {str(n): 1e6 * statistics.median(cases[n]) for n in SIGNALS}
        for variant, cases in seconds.items()
    }
    if "--json" in sys.argv:
        print(json.dumps({"us_per_step": table}, indent=1))
        return
    view = Table(title="microseconds per communication step", title_justify="left")
    view.add_column("variant")
    for n in SIGNALS:
        view.add_column(f"{n} each way", justify="right")
        view.add_column("to C", justify="right", style="dim")
    for variant, row in table.items():
        cells = []
        for n in SIGNALS:
            cells += [f"{row[str(n)]:.3f}", f"{row[str(n)] / table['c_bound'][str(n)]:.1f}"]
        view.add_row(variant, *cells)
    Console().print(view)


if __name__ == "__main__":
    main()
