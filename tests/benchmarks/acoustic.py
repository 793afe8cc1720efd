"""What the loop costs where the work is real: auv-acoustic, 120 s at 10 ms, native FMUs.

The time of the whole loop (three FMUs, two links, everything recorded in memory) beside the time
that each component alone takes for the same motion: its doStep over the same points and inputs,
called from machine code; what setting the inputs costs is taken off. Alone, each must end where
it ended in the loop, to the bit. What is left is the master's, with the sets and gets. Neither a
trace nor a companion run is part of it.

CPU time, the least of several runs that take turns. `python -m tests.benchmarks.acoustic --json`
prints {"acoustic": {"points", "alone_s": {COMPONENT: x}, "engines": {ENGINE: {"loop_s",
"ratio"}}}}, the ratio being that to the plant alone.
"""

from __future__ import annotations

import tempfile
import time
from ctypes import c_int, c_size_t, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from cosim.fmu import FmuSlave
from cosim.fmu.compiled import compiled_library
from cosim.master import EngineName, Run, Session, System
from cosim.scenario import FmuCache, assembled_system, load, prepare
from tests.benchmarks._show import show

END, STEP, REPEATS = 120.0, 0.01, 15
PLANT = "plant"
_SOURCE = Path(__file__).with_name("alone.c")
ENGINES: tuple[EngineName, ...] = ("kernel", "python")


def the_system(folder: Path, end: float = END) -> System:
    """The scenario's, at another step and end, of native FMUs."""
    loaded = load("auv-acoustic", [f"run.end={end}", f"run.step={STEP}"])
    prepared = prepare(loaded, FmuCache(folder, loaded.folder, flavour="native"))
    return assembled_system(prepared)[0]


def the_loop(system: System, engine: EngineName) -> tuple[float, Run]:
    """Seconds from the first point to the last, and the run."""
    with Session(system, engine=engine) as session:
        began = time.process_time()
        session.run_until()
        spent = time.process_time() - began
        run = session.result()
    if run.status != "finished":
        raise SystemExit(f"the run {run.status}: {run.reason}")
    return spent, run


class Alone:
    """A component without the others, flown as it was flown in a run."""

    def __init__(self, system: System, run: Run, name: str) -> None:
        self._name = name
        self._component = system.components[name]
        (instance,) = (s for s in run.instances if s.name == name)
        none = np.zeros(0, np.uint32)
        self._references = np.concatenate(
            [none, *(group.references for group in instance.connected_inputs)]
        )
        self._inputs = np.ascontiguousarray(instance.inputs[: run.points_ns.size])
        self._seconds = run.points_ns / 1e9
        self._sizes = np.diff(run.points_ns) / 1e9
        self._end: NDArray[np.float64] = instance.outputs[run.points_ns.size - 1]
        self._outputs = [column.name for column in instance.output_columns]

    def seconds(self) -> float:
        """What its doSteps take."""
        both, ended = self._run(stepping=True)
        if [ended[name] for name in self._outputs] != self._end.tolist():
            raise SystemExit(f"alone, {self._name} ends elsewhere")
        setting, _ = self._run(stepping=False)
        return both - setting

    def _run(self, *, stepping: bool) -> tuple[float, dict[str, Any]]:
        with FmuSlave(self._component.description, self._name, lambda *_: None) as slave:
            slave.initialise(self._component.parameters, 0.0, float(self._seconds[-1]))
            alone = compiled_library("alone", _SOURCE.read_bytes()).alone
            alone.argtypes = [*[c_void_p] * 4, c_size_t, *[c_void_p] * 3, c_size_t, c_int]
            given = (slave.address("set", "Real"), slave.address("step"), slave.component)
            arrays = (self._inputs, self._seconds, self._sizes)
            began = time.process_time()
            refused = alone(
                *given,
                self._references.ctypes.data,
                self._references.size,
                *(array.ctypes.data for array in arrays),
                self._sizes.size,
                stepping,
            )
            spent = time.process_time() - began
            if refused:
                raise SystemExit(f"{self._name} refused")
            return spent, slave.read(self._outputs)


def main() -> None:
    """Measure, print."""
    with tempfile.TemporaryDirectory() as folder:
        system = the_system(Path(folder))
        run = the_loop(system, "kernel")[1]
        alone = {name: Alone(system, run, name) for name in system.components}
        least = dict.fromkeys((*ENGINES, *alone), float("inf"))
        for _ in range(REPEATS):
            for engine in ENGINES:
                least[engine] = min(least[engine], the_loop(system, engine)[0])
            for name, one in alone.items():
                least[name] = min(least[name], one.seconds())
    figures = {
        "points": run.points_ns.size,
        "alone_s": {name: least[name] for name in alone},
        "engines": {
            engine: {"loop_s": least[engine], "ratio": least[engine] / least[PLANT]}
            for engine in ENGINES
        },
    }
    title = f"auv-acoustic, {END:g} s at {STEP:g} s, {run.points_ns.size} points"
    view = Table(title=title, title_justify="left")
    for column in ("", "time", "per point", "to the plant"):
        view.add_column(column, justify="right" if column else "left")
    for name, spent in least.items():
        label = f"{name} alone" if name in alone else f"the loop, engine {name}"
        each = 1e6 * spent / run.points_ns.size
        view.add_row(
            label, f"{1e3 * spent:.1f} ms", f"{each:.2f} us", f"{spent / least[PLANT]:.2f}"
        )
    show(view, {"acoustic": figures})


if __name__ == "__main__":
    main()
