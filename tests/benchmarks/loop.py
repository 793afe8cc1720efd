"""What the master adds to a communication step, in one run on one machine.

The vehicle, its controller and the sea, wired without links, each at 0.05 s:

* steps: the three FMUs stepped by bare fmpy, nothing exchanged: the bound for any master;
* fmpy: the loop a user writes with fmpy, one getReal and one setReal per connection group;
* ours: the master without a trace, and with one.

Prints a table, and JSON with --json. Figures are ratios to the bound; the microseconds beside
them hold for this machine alone.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from rich.console import Console
from rich.table import Table

from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    Observer,
    System,
    TraceRecorder,
    make_timetable,
    simulate,
)
from cosim.master.wiring import Station
from cosim.trace import TraceWriter
from fmu_src.build import ensure_all

STEP, STEPS, REPEATS = 0.05, 1200, 5
STATE = ("eta.x", "eta.y", "eta.z", "eta.psi", "nu.u", "nu.v", "nu.w", "nu.r")
FORCE = ("force.x", "force.y", "force.z", "moment.z")
WAVES = ("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r")
GROUPS = (
    ("AuvPlant", STATE, "HinfController"),
    ("HinfController", FORCE, "AuvPlant"),
    ("WaveField", WAVES, "AuvPlant"),
)
NAMES = ("AuvPlant", "HinfController", "WaveField")


def bare(folder: Path, *, exchange: bool) -> float:
    """Seconds for the run by fmpy's own calls."""
    slaves, references = {}, {}
    for name in NAMES:
        model = fmpy.read_model_description(str(folder / f"{name}.fmu"))
        slave = FMU2Slave(
            guid=model.guid,
            unzipDirectory=fmpy.extract(str(folder / f"{name}.fmu")),
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=name,
        )
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves[name] = slave
        references[name] = {v.name: v.valueReference for v in model.modelVariables}
    wires = [
        (
            slaves[a],
            [references[a][n] for n in names],
            slaves[b],
            [references[b][n] for n in names],
        )
        for a, names, b in GROUPS
    ]
    began = time.perf_counter()
    for k in range(STEPS):
        if exchange:
            values = [source.getReal(out) for source, out, _, _ in wires]
            for (_, _, target, into), row in zip(wires, values, strict=True):
                target.setReal(into, row)
        for slave in slaves.values():
            slave.doStep(k * STEP, STEP)
    spent = time.perf_counter() - began
    for slave in slaves.values():
        slave.terminate()
        slave.freeInstance()
    return spent


def ours(folder: Path, *, trace: bool) -> float:
    """Seconds for the run by this project's master."""
    components = {name: Component(describe_fmu(folder / f"{name}.fmu")) for name in NAMES}
    connections = [
        Connection(Endpoint(a, name), Endpoint(b, name)) for a, names, b in GROUPS for name in names
    ]
    step = round(STEP * 1e9)
    timetable = make_timetable({}, step, step * STEPS, "align")
    system = System(components, connections, {}, {}, timetable, 1e9)
    watch = Stopwatch()
    if not trace:
        simulate(system, [watch])
        return time.perf_counter() - watch.began
    with (
        tempfile.TemporaryDirectory() as scratch,
        TraceWriter(Path(scratch, "run.mcap"), run={}) as writer,
    ):
        simulate(system, [TraceRecorder(writer, system), watch])
        writer.finish({})
        return time.perf_counter() - watch.began


class Stopwatch(Observer):
    """Starts when the slaves are loaded and initialised, as for bare fmpy."""

    began = 0.0

    def begin(self, stations: Sequence[Station]) -> None:
        """Start."""
        del stations
        self.began = time.perf_counter()

    def point(self, k: int) -> None:
        """Look on."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Look on."""


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = ensure_all(Path(scratch), NAMES)[0].path.parent
        cases: dict[str, Callable[[], float]] = {
            "steps alone": lambda: bare(folder, exchange=False),
            "loop by fmpy": lambda: bare(folder, exchange=True),
            "ours": lambda: ours(folder, trace=False),
            "ours, with trace": lambda: ours(folder, trace=True),
        }
        seconds: dict[str, list[float]] = {name: [] for name in cases}
        for _ in range(REPEATS):  # interleaved: a slow spell of the machine hits all alike
            for name, case in cases.items():
                seconds[name].append(case())
    median = {name: statistics.median(values) for name, values in seconds.items()}
    bound = median["steps alone"]
    rows = [
        {"case": name, "us_per_step": 1e6 * value / STEPS, "ratio_to_steps": value / bound}
        for name, value in median.items()
    ]
    if "--json" in sys.argv:
        print(json.dumps({"benchmark": "loop", "steps": STEPS, "rows": rows}, indent=1))
        return
    table = Table(title=f"{STEPS} communication steps, median of {REPEATS}", title_justify="left")
    for column in ("case", "us per step", "ratio to steps alone"):
        table.add_column(column, justify="left" if column == "case" else "right")
    for row in rows:
        table.add_row(str(row["case"]), f"{row['us_per_step']:.1f}", f"{row['ratio_to_steps']:.2f}")
    Console().print(table)


if __name__ == "__main__":
    main()
