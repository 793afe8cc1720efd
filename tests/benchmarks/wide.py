"""What a step costs with many FMUs: 10, 100, 1000 of them, each with ten connections.

Tiny FMUs in C, whose ten inputs read outputs of others drawn at random; a step of 1 ms, held inputs
(Jacobi), nothing recorded, rows not kept. Beside it a loop in C for these FMUs alone, which gathers
inputs, sets, steps and gets; the two take turns, and the least of several turns counts. Setting up
is told apart: reading the description once, wiring, instantiating, initialising, the first steps.

`python -m tests.benchmarks.wide --json` prints {"wide": {FMUS: {"c_bound_us", "kernel_us",
"ratio", "set_up_s"}}}.
"""

from __future__ import annotations

import ctypes
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from rich.table import Table

from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, Endpoint, Session, System, make_schedule
from tests.benchmarks._show import show
from tests.benchmarks._tiny import tiny_fmu

SIGNALS = 10
STEPS = {10: 20_000, 100: 2_000, 1000: 200}
"""Of a turn, by the number of FMUs."""
TURNS = 7
_MS = 1_000_000
_CALLS = ("fmi2GetReal", "fmi2SetReal", "fmi2DoStep")


def sources(many: int) -> list[int]:
    """The output that each input reads, one of another FMU: component * SIGNALS + signal."""
    drawn = random.Random(many)  # noqa: S311 - the same graph every time
    others = [[j for j in range(many) if j != i] for i in range(many)] if many < 200 else None
    found = []
    for i in range(many):
        for _ in range(SIGNALS):
            other = drawn.choice(others[i]) if others else (i + drawn.randrange(1, many)) % many
            found.append(other * SIGNALS + drawn.randrange(SIGNALS))
    return found


def system(fmu: Path, many: int, steps: int) -> System:
    """The FMUs and their connections."""
    described = describe_fmu(fmu)
    connections = [
        Connection(
            Endpoint(f"c{source // SIGNALS}", f"x[{source % SIGNALS + 1}]"),
            Endpoint(f"c{i // SIGNALS}", f"u[{i % SIGNALS + 1}]"),
        )
        for i, source in enumerate(sources(many))
    ]
    components = {f"c{i}": Component(described) for i in range(many)}
    return System(components, connections, {}, {}, make_schedule({}, _MS, _MS * steps, "grid"), 1e9)


def measured(fmu: Path, many: int) -> dict[str, float]:
    """Microseconds per step of both loops, and seconds to set ours up."""
    steps = STEPS[many]
    began = time.process_time()
    asked = system(fmu, many, steps * (TURNS + 1))
    with Session(asked, engine="kernel", keep=False) as session:
        session.step(10)
        set_up = time.process_time() - began
        bound = bare_graph(fmu, many)
        least = {"c_bound_us": float("inf"), "kernel_us": float("inf")}
        for _ in range(TURNS):
            for name, go in (("kernel_us", session.step), ("c_bound_us", bound)):
                began = time.process_time()
                go(steps)
                spent = (time.process_time() - began) / steps * 1e6
                least[name] = min(least[name], spent)
    return {**least, "ratio": least["kernel_us"] / least["c_bound_us"], "set_up_s": set_up}


def bare_graph(fmu: Path, many: int) -> Callable[[int], None]:
    """The loop in C over as many instances by fmpy."""
    model, folder = fmpy.read_model_description(str(fmu)), fmpy.extract(str(fmu))
    slaves = []
    for i in range(many):
        slave = FMU2Slave(
            guid=model.guid,
            unzipDirectory=folder,
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=f"c{i}",
        )
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves.append(slave)
    dll = slaves[0].dll
    arguments = [
        *(ctypes.cast(dll[name], ctypes.c_void_p) for name in _CALLS),
        (ctypes.c_void_p * many)(*(slave.component for slave in slaves)),
        ctypes.c_long(many),
        (ctypes.c_uint * SIGNALS)(*range(SIGNALS)),
        (ctypes.c_uint * SIGNALS)(*range(SIGNALS, 2 * SIGNALS)),
        (ctypes.c_long * (many * SIGNALS))(*sources(many)),
        (ctypes.c_double * (many * SIGNALS))(),
        ctypes.c_double(1e-3),
    ]

    def go(steps: int) -> None:
        if dll["bare_graph"](*arguments, ctypes.c_long(steps)):
            raise SystemExit("the bare loop failed")

    return go


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as scratch:
        fmu = tiny_fmu(SIGNALS, Path(scratch))
        found = {str(many): measured(fmu, many) for many in STEPS}
    view = Table(title="microseconds per step, least of several turns", title_justify="left")
    for column in ("FMUs", "a loop in C", "kernel", "ratio", "set-up"):
        view.add_column(column, justify="right")
    for many, row in found.items():
        figures = (f"{row['c_bound_us']:.3g}", f"{row['kernel_us']:.3g}", f"{row['ratio']:.1f}")
        view.add_row(many, *figures, f"{row['set_up_s']:.2f} s")
    show(view, {"wide": found})


if __name__ == "__main__":
    main()
