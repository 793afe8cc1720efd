"""What a step of an isolated slave costs, against the same slave in the process of the master.

A ring of n tiny FMUs in C under Jacobi, a signal each, or as many as a column says; at each point
every slave is called three times: get, set, step. Variants:

* in_process: no slave is isolated;
* isolated: every slave in a process of its own, on shared memory and futexes;
* isolated_threads: the same, stepped on two threads (`run.threads`);
* isolated_pipes: the same as `isolated`, each process asleep on a pipe, as where there is no futex;
* pipe_round_trip: a byte to another process and back over two pipes, nothing else, per point.

A figure is the least of many short turns, in microseconds per point and slave; the variants take
turns. `python -m tests.benchmarks.isolation --json` prints {"us_per_step": {VARIANT: {"n=1": x,
...}}, "us_per_call": {...}}: per call, what an isolated slave takes beyond one in process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rich.table import Table

from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import Component, Connection, Endpoint, Session, System, make_schedule
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu

CASES = {"n=1": (1, 1), "n=2": (2, 1), "n=6": (6, 1), "n=1, 6 signals": (1, 6)}
"""Number of slaves, and of signals of each."""
STEP_NS = 1_000_000
TURNS, POINTS = 40, 1000
CALLS = 3
"""Of each slave at a point."""


def ring(fmu: FmuDescription, slaves: int, signals: int, *, isolate: bool, threads: int) -> System:
    """Each slave gets the outputs of the one before it, the first one those of the last."""
    names = [f"s{i}" for i in range(slaves)]
    connections = [
        Connection(Endpoint(names[i - 1], f"x[{j}]"), Endpoint(names[i], f"u[{j}]"))
        for i in range(slaves)
        for j in range(1, signals + 1)
    ]
    schedule = make_schedule({}, STEP_NS, STEP_NS * POINTS * (TURNS + 1), "grid")
    components = {name: Component(fmu, isolate=isolate) for name in names}
    return System(components, connections, {}, {}, schedule, threads=threads)


def pipe_round_trips(number: int) -> float:
    """Seconds of so many round trips of a byte to another process over two pipes."""
    there, back = os.pipe(), os.pipe()
    child = os.fork()
    if child == 0:
        for _ in range(number):
            os.write(back[1], os.read(there[0], 1))
        os._exit(0)
    began = time.perf_counter()
    for _ in range(number):
        os.write(there[1], b".")
        os.read(back[0], 1)
    took = time.perf_counter() - began
    os.waitpid(child, 0)
    for end in (*there, *back):
        os.close(end)
    return took


def measured(folder: Path, slaves: int, signals: int) -> dict[str, float]:
    """Microseconds per point and slave, by variant."""
    fmu = describe_fmu(tiny_fmu(signals, folder))
    given = {
        "in_process": (False, 1),
        "isolated": (True, 1),
        "isolated_threads": (True, 2),
    }
    turns: dict[str, Callable[[], float]] = {"pipe_round_trip": lambda: pipe_round_trips(POINTS)}
    with ExitStack() as opened:
        for name, (isolate, threads) in given.items():
            system = ring(fmu, slaves, signals, isolate=isolate, threads=threads)
            session = opened.enter_context(Session(system))
            turns[name] = lambda session=session: turn(session)
        turns["isolated_pipes"] = opened.enter_context(without_futex(fmu, slaves, signals))
        least = dict.fromkeys(turns, float("inf"))
        for _ in range(TURNS):
            for name, take in turns.items():
                least[name] = min(least[name], take())
    each = {name: 1e6 * seconds / POINTS for name, seconds in least.items()}
    return {name: us if name == "pipe_round_trip" else us / slaves for name, us in each.items()}


_OTHER_SYSTEM = """
import sys
import fmpy, numpy, psutil  # they know this system, and no other
import fmpy.fmi1, fmpy.fmi2, fmpy.fmi3
here, sys.platform = sys.platform, "sunos5"
from cosim.fmu import SlaveProcess  # what processes sleep on is decided when this is loaded
sys.platform = here
from tests.benchmarks.isolation import serve_turns
serve_turns(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
"""


@contextmanager
def without_futex(fmu: FmuDescription, slaves: int, signals: int) -> Iterator[Callable[[], float]]:
    """A turn of isolated slaves in another process, which takes its system for one without."""
    line = [sys.executable, "-c", _OTHER_SYSTEM, str(fmu.path), str(slaves), str(signals)]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:  # noqa: S603 - ourselves

        def take() -> float:
            print("turn", file=other.stdin, flush=True)
            assert other.stdout is not None
            return float(other.stdout.readline())

        yield take
        other.communicate()


def serve_turns(fmu: str, slaves: int, signals: int) -> None:
    """Take a turn for each line of standard input, and print its seconds."""
    system = ring(describe_fmu(Path(fmu)), slaves, signals, isolate=True, threads=1)
    with Session(system) as session:
        for _ in sys.stdin:
            print(turn(session), flush=True)


def turn(session: Session) -> float:
    """Seconds of so many points."""
    began = time.perf_counter()
    session.step(POINTS)
    return time.perf_counter() - began


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch:
        found = {case: measured(Path(scratch), *sizes) for case, sizes in CASES.items()}
    variants = list(next(iter(found.values())))
    per_step = {name: {case: found[case][name] for case in found} for name in variants}
    per_call = {
        name: {case: (us - per_step["in_process"][case]) / CALLS for case, us in by_case.items()}
        for name, by_case in per_step.items()
        if name.startswith("isolated")
    }
    view = Table(title="µs per step of one slave, least of many turns", title_justify="left")
    for column in ("", *found):
        view.add_column(column, justify="right" if column else "left")
    for name, by_case in per_step.items():
        view.add_row(name, *(f"{us:.2f}" for us in by_case.values()))
    for name, by_case in per_call.items():
        view.add_row(f"{name}, per call", *(f"{us:.2f}" for us in by_case.values()))
    show(view, {"us_per_step": per_step, "us_per_call": per_call})


if __name__ == "__main__":
    main()
