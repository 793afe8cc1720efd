"""What a run of a study costs beside its steps, by CPU time.

Section 5's loop over a wire, native FMUs, one start value that differs from run to run, and two
metrics: 100 steps, where setting up counts, and 10,000, where the steps do. Variants:

* c_bound: a loop in C over the same two FMUs, reset for each run; nothing is recorded or checked;
* fmpy: the loop that a user writes with fmpy, the FMUs reset for each run;
* kernel_loop: the steps of the run alone, by this project's kernel, every signal in memory;
* study: a run of a study in this process;
* supervised: the same as `cosim study run` executes it, in a child that is kept.

A figure is the least of several turns, children included, divided by their runs. The last values
that the variants come to are compared.

`python -m tests.benchmarks.study_runs --json` prints {"us_per_run": {VARIANT: {"100": x, ...}}}.
"""

from __future__ import annotations

import contextlib
import ctypes
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from rich.table import Table

from cosim.core import LossError
from cosim.fmu import FmuDescription
from cosim.fmu.compiled import compiled_library
from cosim.hinf.delay_lti import one_thread
from cosim.master import Component, Session
from cosim.scenario import assembled_system
from cosim.study import Plan, Study, execute_study, load_study, plan_of
from tests.benchmarks._cpu import cpu_s
from tests.benchmarks._show import show

LENGTHS = {100: 400, 10_000: 100}
"""Steps of a run -> runs in a turn."""
STEP = 0.01
TURNS = 7
START = "initial.x[1]"
_SOURCE = Path(__file__).with_name("bare_run.c")


def plan_for(steps: int, runs: int) -> Plan:
    """A study of so many runs of so many steps."""
    base = load_study("delay-margin").base
    wires = [c.model_copy(update={"link": None}) for c in base.scenario.connections]
    scenario = base.scenario.model_copy(update={"links": {}, "connections": wires})
    study = Study(
        title="short",
        scenario=base.name,
        set={"run.end": steps * STEP, "run.step": STEP},
        vary=[
            {"kind": "random", "path": f"components.plant.parameters.{START}", "uniform": [1, 9]}
        ],
        samples=runs,
        metrics={
            "x": "final.plant.x[1]",
            "rms": {"signal": ["plant.x[1]", "plant.x[2]"], "reduce": "rms"},
        },
    )
    return plan_of(study, replace(base, scenario=scenario))


class ByHand:
    """The two slaves of a plan by fmpy, as a user has them."""

    def __init__(self, plan: Plan) -> None:
        prepared = plan.runner._prepared(plan.runner._loaded(0, ""))
        self.system, _ = assembled_system(prepared)
        self.slaves = [_slave(self.system.components[n]) for n in ("plant", "controller")]
        self.starts = np.array([plan.runner.points[run][0] for run in range(plan.count)])
        self.steps = round(self.system.comm_schedule.end_ns / 1e9 / STEP)

    def by_fmpy(self, runs: int) -> float:
        """Fly the last of the runs; return the last value of the last one."""
        plant, controller = self.slaves
        for start in self.starts[-runs:].tolist():
            plant.values[0] = start
            for one in self.slaves:
                one.fmu.reset()
                one.fmu.setReal(one.parameters, one.values)
                one.fmu.setupExperiment(startTime=0.0, stopTime=self.steps * STEP)
                one.fmu.enterInitializationMode()
                one.fmu.exitInitializationMode()
            for k in range(self.steps):
                controller.fmu.setReal(controller.inputs, plant.fmu.getReal(plant.outputs))
                plant.fmu.setReal(plant.inputs, controller.fmu.getReal(controller.outputs))
                plant.fmu.doStep(k * STEP, STEP)
                controller.fmu.doStep(k * STEP, STEP)
        return float(plant.fmu.getReal(plant.outputs[:1])[0])

    def in_c(self) -> float:
        """Fly every run; return the last value of the last one."""
        runs = compiled_library("bare_run", _SOURCE.read_bytes()).bare_runs
        last = np.zeros(self.starts.size)
        kept = [one.in_c() for one in self.slaves]
        refused = runs(
            *(one[0].ctypes.data_as(ctypes.c_void_p) for one in kept),
            self.starts.ctypes.data_as(ctypes.c_void_p),
            last.ctypes.data_as(ctypes.c_void_p),
            *(ctypes.c_size_t(self.starts.size), ctypes.c_size_t(self.steps)),
            ctypes.c_double(STEP),
        )
        if refused:
            raise SystemExit("the loop in C was refused a call")
        return float(last[-1])


class _ByFmpy:
    """One slave by fmpy, its references and parameters."""

    def __init__(
        self, fmu: FMU2Slave, description: FmuDescription, given: dict[str, float]
    ) -> None:
        ports = description.ports
        self.fmu = fmu
        self.parameters = [ports[name].reference for name in given]
        self.values = list(given.values())
        of = {"output": "x[" if "x[1]" in ports and ports["x[1]"].causality == "output" else "u["}
        of["input"] = "u[" if of["output"] == "x[" else "x["
        self.outputs, self.inputs = (
            [
                p.reference
                for p in ports.values()
                if p.causality == kind and p.name.startswith(begin)
            ]
            for kind, begin in of.items()
        )

    def in_c(self) -> tuple[np.ndarray[Any, Any], ...]:
        """`Slave` of bare_run.c, and the arrays that it points to."""
        calls = ("Reset", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode")
        calls += ("GetReal", "SetReal", "DoStep")
        arrays = [np.array(r, np.uint32) for r in (self.outputs, self.inputs, self.parameters)]
        arrays.append(np.array(self.values))
        addresses = [ctypes.cast(self.fmu.dll[f"fmi2{c}"], ctypes.c_void_p).value for c in calls]
        words = [self.fmu.component, *addresses, *(array.ctypes.data for array in arrays)]
        sizes = [len(self.outputs), len(self.inputs), len(self.parameters)]
        return np.array([*words, *sizes], np.uint64), *arrays


def _slave(component: Component) -> _ByFmpy:
    path = str(component.description.path)
    model = fmpy.read_model_description(path)
    fmu = FMU2Slave(
        guid=model.guid,
        unzipDirectory=fmpy.extract(path),
        modelIdentifier=model.coSimulation.modelIdentifier,
        instanceName="by hand",
    )
    fmu.instantiate()
    given = dict(component.parameters)
    first = {START: given.pop(START)} if START in given else {}
    return _ByFmpy(fmu, component.description, {**first, **given})


class Worker:
    """What a study asks of a worker: it is kept here, and no batch is executed.

    function, job : `function(job, runs)` executes runs as `cosim study run` does.
    """

    size = 1

    def __init__(self, plan: Plan) -> None:
        self.notice: Callable[[str], None] = lambda _text: None
        self.function: Any = None
        self.job: Any = None
        with tempfile.TemporaryDirectory() as folder, contextlib.suppress(LossError):
            execute_study(plan, Path(folder), lambda: contextlib.nullcontext(self))

    def run_batches(self, function: Any, job: Any, _next_batch: Any) -> Iterator[Any]:
        """Keep what is asked for."""
        self.function, self.job = function, job
        return iter(())


def in_this_process(runner: Any, run: int) -> float:
    """Execute a run, and take the two figures of `plan_for`; return the first."""
    outcome, done = runner.execute_run(run, runner.wanted)
    t = done.points_ns / 1e9
    squares = sum(done.signal("plant", name) ** 2 for name in ("x[1]", "x[2]"))
    np.sqrt(np.trapezoid(squares, t) / (t[-1] - t[0]))
    return float(outcome.to_json()["final"]["plant.x[1]"])


@one_thread
def measured(steps: int, runs: int) -> dict[str, float]:
    """Microseconds of a run, by variant."""
    plan = plan_for(steps, runs)
    worker = Worker(plan)
    by_hand = ByHand(plan)
    series = plan_for(steps, runs).runner
    series.supervise_no_more()
    numbers = [*range(runs)]
    few = range(runs - 10, runs)
    session = Session(by_hand.system).__enter__()
    variants: dict[str, tuple[int, Callable[[], Any]]] = {
        "c_bound": (runs, by_hand.in_c),
        "fmpy": (len(few), lambda: by_hand.by_fmpy(len(few))),
        "kernel_loop": (1, session.run_until),
        "study": (runs, lambda: [in_this_process(series, run) for run in numbers][-1]),
        "supervised": (runs, lambda: worker.function(worker.job, numbers)[-1].values[0]),
    }
    least = dict.fromkeys(variants, float("inf"))
    last = {}
    for _ in range(TURNS):
        for name, (count, execute) in variants.items():
            if name == "kernel_loop":
                session.begin_again(by_hand.system)
            # one run of microseconds has no children, and looking at those takes longer
            clock = time.process_time if name == "kernel_loop" else cpu_s
            began = clock()
            last[name] = execute()
            least[name] = min(least[name], (clock() - began) / count)
    ends = {value for name, value in last.items() if name != "kernel_loop"}
    if max(ends) - min(ends) > 1e-12 * max(map(abs, ends)):
        raise SystemExit(f"the variants end elsewhere: {last}")
    session.close()
    return {name: round(1e6 * value, 2) for name, value in least.items()}


def main() -> None:
    """Measure, print."""
    found = {steps: measured(steps, runs) for steps, runs in LENGTHS.items()}
    view = Table(title="CPU time of a run [us]", title_justify="left")
    for column in ("variant", *(f"{steps:,} steps" for steps in LENGTHS)):
        view.add_column(column, justify="right" if column != "variant" else "left")
    for name in found[100]:
        view.add_row(name, *(f"{found[steps][name]:,.1f}" for steps in LENGTHS))
    show(view, {"us_per_run": {n: {str(s): found[s][n] for s in LENGTHS} for n in found[100]}})


if __name__ == "__main__":
    main()
