"""What a master costs per communication step, in one run on one machine.

Two tiny FMUs in C, N signals each way, a step of 1 ms, held inputs (Jacobi). Variants:

* c_bound: a loop in C for these two FMUs alone; nothing is recorded;
* kernel, python_loop: this project's engines, no link, every signal recorded in memory;
* kernel_no_word, kernel_no_mode, kernel_no_range, kernel_bare: the kernel without what makes it
  safe, one thing or all: the word that names the call in progress, for who looks on from outside;
  the mode of the floating-point unit, restored behind a call that changes it; the range of complete
  rows, and their sum;
* kernel_links_recorded: packet links with jitter and loss both ways, recorded in memory;
* kernel_links_mcap: the same, with the trace on disk, opening and closing of the file included;
* fmpy_per_signal, fmpy_batched: the loop that a user writes with fmpy, nothing recorded;
* other masters, where they are installed, nothing recorded.

A figure is the least of many short turns; the variants take turns, and setting up does not count.
Whatever else the machine does adds to a turn, and never takes from it: the least is what the
work costs.

`python -m tests.benchmarks.loop --json` prints {"us_per_step": {VARIANT: {"1": x, ...}}}, null
for a master that is not installed.
"""

from __future__ import annotations

import ctypes
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import patch

import fmpy
from fmpy.fmi2 import FMU2Slave
from rich.table import Table

from cosim.fmu import describe_fmu
from cosim.fmu.compiled import library_source
from cosim.master import (
    Component,
    ComponentInstance,
    Connection,
    Endpoint,
    EngineName,
    Link,
    Observer,
    Session,
    System,
    TraceRecorder,
    load_kernel,
    make_schedule,
    simulate,
)
from cosim.network import Jitter, PacketLink
from cosim.trace import TraceWriter
from tests.benchmarks._peers import PEERS, ByPeer
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu

SIGNALS = (1, 6, 20)
STEP = 1e-3
TURNS = 60
SECONDS = 120.0
"""After which no more turns are taken with a number of signals, beyond the first five."""
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


def c_bound(fmu: Path, n: int) -> Iterator[float]:
    """Seconds per step of the loop in C."""
    a, b = pair(fmu)
    steps = 40_000
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
    while True:
        began = time.perf_counter()
        failed = loop(*arguments, ctypes.c_long(steps))
        spent = time.perf_counter() - began
        if failed:
            raise SystemExit("the bare loop failed")
        _check(a)
        yield spent / steps


def by_fmpy(fmu: Path, n: int, *, batched: bool) -> Iterator[float]:
    """Seconds per step of a loop over fmpy's own methods."""
    a, b = pair(fmu)
    steps, k = 200, 0
    out, into = list(range(n)), list(range(n, 2 * n))
    while True:
        began = time.perf_counter()
        for _ in range(steps):
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
            k += 1
        spent = time.perf_counter() - began
        _check(a)
        yield spent / steps


def _check(slave: FMU2Slave) -> None:
    """Coupled, x = u = 1 stays as it is; without the connections it would die away."""
    if slave.getReal([0]) != [1.0]:
        raise SystemExit("the FMUs were not coupled")


def system_of(fmu: Path, n: int, *, steps: int, links: bool) -> System:
    """Two of the FMUs, wired both ways, over links with jitter and loss or without."""
    described = describe_fmu(fmu)
    ways = {}
    if links:
        ways = {
            name: PacketLink(
                name, 10 * _MS, 0, 30 * _MS, jitter=Jitter("uniform", width_ns=20 * _MS), loss=0.05
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
    comm_schedule = make_schedule(channels, _MS, _MS * steps, "grid")
    components = {name: Component(described) for name in ("a", "b")}
    return System(components, connections, channels, {}, comm_schedule, 1e9)


def ours(
    fmu: Path,
    n: int,
    *,
    engine: EngineName,
    steps: int,
    turns: int,
    links: bool = False,
    without: Sequence[str] = (),
) -> Iterator[float]:
    """Seconds per step of this project's master; `without` : lines of the kernel's C."""
    system = system_of(fmu, n, steps=steps * turns, links=links)
    while True:
        watch = Stopwatch()
        library = patch("cosim.master.kernel.load_kernel", lambda: kernel_without(without))
        with library, Session(system, [watch], engine=engine) as session:
            for _ in range(turns):
                began = time.perf_counter()
                session.step(steps)
                yield (time.perf_counter() - began) / steps
            run = session.result()
        if run.status == "stopped" and not links and run.signal("a", "x[1]")[-1] != 1.0:
            raise SystemExit("the FMUs were not coupled")


def kernel_without(lines: Sequence[str]) -> ctypes.CDLL:
    """The kernel without some of its lines."""
    source = library_source("kernel").decode()
    for line in lines:
        if line not in source:
            raise SystemExit(f"the kernel has no line {line!r}")
        source = source.replace(line, "if (0)" if line.startswith("if") else "")
    with patch("cosim.master.compiled.library_source", lambda _name: source.encode()):
        return load_kernel.__wrapped__()


def ours_on_disk(fmu: Path, n: int) -> Iterator[float]:
    """Seconds per step with links and a trace, of a whole run."""
    steps = 20_000
    system = system_of(fmu, n, steps=steps, links=True)
    while True:
        watch = Stopwatch()
        with (
            tempfile.TemporaryDirectory() as scratch,
            TraceWriter(Path(scratch, "run.mcap"), run={}) as writer,
        ):
            simulate(system, [TraceRecorder(writer, system), watch], engine="kernel")
            writer.finish({})
            spent = time.perf_counter() - watch.began
        yield spent / steps


class Stopwatch(Observer):
    """Knows when the first point begins, all slaves initialised."""

    began = 0.0
    reads_inputs = False

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Start."""
        # memory is handed out when it is first touched: not the master's cost
        for instance in instances:
            instance.rows[:] = instance.rows.copy()
        self.began = time.perf_counter()

    def rows_complete(self, first: int, last: int) -> None:
        """Look on."""

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Look on."""


Variant = Callable[[Path, int], Any]
kernel = partial(ours, engine="kernel", steps=40_000, turns=5)
SAFE = {
    "word": "*word = place | o->number;",
    "mode": "if (modes() != saved)",
    "range": "if ((status = outside(r, here, k)))",
}
VARIANTS: dict[str, Variant] = {
    "c_bound": c_bound,
    "kernel": kernel,
    **{f"kernel_no_{what}": partial(kernel, without=[line]) for what, line in SAFE.items()},
    "kernel_bare": partial(kernel, without=[*SAFE.values()]),
    "kernel_links_recorded": partial(kernel, links=True),
    "kernel_links_mcap": ours_on_disk,
    "python_loop": partial(ours, engine="python", steps=1_000, turns=30),
    "fmpy_batched": partial(by_fmpy, batched=True),
    "fmpy_per_signal": partial(by_fmpy, batched=False),
    **{name: partial(ByPeer, name) for name in PEERS},
}
SELDOM = {"kernel_links_mcap": 2}
"""Variants whose turns are whole runs: one turn in so many."""


def measured(n: int, fmu: Path) -> dict[str, float | None]:
    """Least seconds per step of every variant that there is."""
    least: dict[str, float | None] = dict.fromkeys(VARIANTS)
    going: dict[str, Any] = {}
    for name, variant in VARIANTS.items():
        if name not in PEERS or find_spec(PEERS[name].module) is not None:
            going[name] = variant(fmu, n)
    began = time.perf_counter()
    for turn in range(TURNS):
        if turn >= 5 and time.perf_counter() - began > SECONDS:
            break
        for name in [name for name in going if turn % SELDOM.get(name, 1) == 0]:
            try:
                found = next(going[name])
            except RuntimeError as error:
                _give_up(name, error)
                del going[name]
                continue
            least[name] = min(found, least[name] or found)
    for name, variant in going.items():
        try:
            variant.close()
        except RuntimeError as error:
            _give_up(name, error)
            least[name] = None
    return least


def _give_up(name: str, error: RuntimeError) -> None:
    print(f"{name} cannot be measured: {error}", file=sys.stderr)


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch:
        columns = {n: measured(n, tiny_fmu(n, Path(scratch))) for n in SIGNALS}
    table: dict[str, dict[str, float | None]] = {
        variant: {
            str(n): None if (least := columns[n][variant]) is None else 1e6 * least for n in SIGNALS
        }
        for variant in VARIANTS
    }
    view = Table(title="microseconds per communication step (least)", title_justify="left")
    view.add_column("variant")
    for n in SIGNALS:
        view.add_column(f"{n} each way", justify="right")
        view.add_column("to C", justify="right", style="dim")
    for variant, row in table.items():
        cells = []
        for n in SIGNALS:
            found, bound = row[str(n)], table["c_bound"][str(n)]
            known = found is not None and bound is not None
            cells += [f"{found:.3f}", f"{found / bound:.1f}"] if known else ["-", ""]
        view.add_row(variant, *cells)
    show(view, {"us_per_step": table}, "- : not installed")


if __name__ == "__main__":
    main()
