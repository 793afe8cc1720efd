"""Other masters over the same two FMUs: a process each, told how many steps to take.

Each takes steps of fixed size without recording anything; the hand-over is that of Jacobi. A
process of its own, because each loads native code and prints what it likes. What is timed is its
own loop, in one call for many steps where it has such a call.

`python -m tests.benchmarks._peers NAME FMU SIGNALS` reads numbers of steps from stdin and answers
each with the nanoseconds that they took, and a 0 with the first output of the first FMU.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import importlib.metadata
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

STEP = 1e-3
_STEPS = 500


class Driven(NamedTuple):
    """A simulation that is ready: `go` takes so many steps, `value` reads x[1] of the first FMU."""

    go: Callable[[int], Any]
    value: Callable[[], float]


class Peer(NamedTuple):
    """A tool: the module that it is, and how its simulation is set up."""

    module: str
    prepare: Callable[[str, int], Driven] | None


def _ecos(fmu: str, n: int) -> Driven:
    for file in importlib.metadata.files("tbb") or ():
        if file.name == "libtbb.so.12":
            ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)
    ecospy: Any = importlib.import_module("ecospy")
    ecospy.EcosLib.set_log_level("warn")
    structure = ecospy.EcosSimulationStructure()
    for name in "ab":
        structure.add_model(name, fmu)
    for source, target in ("ab", "ba"):
        for i in range(1, n + 1):
            structure.make_real_connection(f"{source}::x[{i}]", f"{target}::u[{i}]")
    simulation = ecospy.EcosSimulation(STEP, structure=structure)
    if not simulation.init():
        raise RuntimeError(ecospy.EcosLib.get_last_error())
    return Driven(simulation.step, lambda: float(simulation.get_real("a::x[1]")))


def _libcosim(fmu: str, n: int) -> Driven:
    execution_of: Any = importlib.import_module("libcosimpy.CosimExecution")
    slaves: Any = importlib.import_module("libcosimpy.CosimSlave")
    observers: Any = importlib.import_module("libcosimpy.CosimObserver")
    logging: Any = importlib.import_module("libcosimpy.CosimLogging")
    logging.log_output_level(logging.CosimLogLevel.WARNING)
    execution = execution_of.CosimExecution.from_step_size(round(STEP * 1e9))
    kept = [slaves.CosimLocalSlave(fmu, name) for name in "ab"]
    a, b = (execution.add_local_slave(slave) for slave in kept)
    for source, target in ((a, b), (b, a)):
        for i in range(n):
            execution.connect_real_variables(source, i, target, n + i)
    observer = observers.CosimObserver.create_last_value()

    def go(steps: int) -> None:
        if not execution.step(steps):
            raise RuntimeError(str(execution.status()))

    def value() -> float:
        # an observer costs time at every step: it comes when the steps that count are over
        execution.add_observer(observer)
        go(1)
        (found,) = observer.last_real_values(a, [0])
        del kept[:]
        return float(found)

    return Driven(go, value)


def _omsimulator(fmu: str, n: int) -> Driven:
    """Through the functions of its library in C, which all its versions have."""
    spec = find_spec("OMSimulator")
    folder = Path(spec.origin or "").parent if spec else Path()
    library = next(
        f for at in (folder, folder.parent) for f in at.glob("*OMSimulator.*[sd][olyl]*")
    )
    oms: Any = ctypes.CDLL(str(library))

    def call(name: str, *given: Any) -> None:
        texts = (g.encode() if isinstance(g, str) else g for g in given)
        if getattr(oms, f"oms_{name}")(*texts) > 1:
            raise RuntimeError(f"oms_{name} failed")

    # the number of the kind "weakly coupled" is one less since there are no TLM systems
    weakly_coupled = 2 if hasattr(oms, "oms_addTLMBus") else 1
    call("setTempDirectory", tempfile.mkdtemp())
    call("newModel", "model")
    call("addSystem", "model.root", weakly_coupled)
    for name in "ab":
        call("addSubModel", f"model.root.{name}", fmu)
    for source, target in ("ab", "ba"):
        for i in range(1, n + 1):
            ends = (f"model.root.{source}.x[{i}]", f"model.root.{target}.u[{i}]")
            call("addConnection", *ends, ctypes.c_bool(False))  # noqa: FBT003 - an argument in C
    call("setResultFile", "model", "", 1)
    call("setStopTime", "model", ctypes.c_double(1e9))
    call("setFixedStepSize", "model.root", ctypes.c_double(STEP))
    call("instantiate", "model")
    call("initialize", "model")
    done = 0

    def go(steps: int) -> None:
        nonlocal done
        done += steps
        call("stepUntil", "model", ctypes.c_double(done * STEP))

    def value() -> float:
        found = ctypes.c_double()
        call("getReal", "model.root.a.x[1]", ctypes.byref(found))
        return found.value

    return Driven(go, value)


PEERS = {
    "ecos": Peer("ecospy", _ecos),
    "libcosim": Peer("libcosimpy", _libcosim),
    "omsimulator": Peer("OMSimulator", _omsimulator),
    "pyfmi": Peer("pyfmi", None),
}
"""`prepare` None: its set-up cannot be told from its loop, so that it is not measured."""


class ByPeer:
    """A peer at work: `next` gives seconds per step, `close` looks whether it did its work.

    Raises
    ------
    RuntimeError : the peer does not do what it is asked for, in its own words.
    """

    def __init__(self, name: str, fmu: Path, n: int) -> None:
        self._output = tempfile.TemporaryFile("w+")  # noqa: SIM115 - read when the process has ended
        self._process = subprocess.Popen(  # noqa: S603 - this file
            [sys.executable, str(Path(__file__).resolve()), name, str(fmu), str(n)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._output,
            text=True,
        )

    def __next__(self) -> float:
        return int(self._answer(_STEPS)) / 1e9 / _STEPS

    def close(self) -> None:
        """End it; coupled, x = u = 1 has stayed as it is, alone it would have died away."""
        try:
            value = float(self._answer(0))
            if value != 1.0:
                raise RuntimeError(f"the FMUs were not coupled: x[1] = {value}, expected 1")
        finally:
            self._process.kill()
            self._process.communicate()
            self._output.close()

    def _answer(self, steps: int) -> str:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        with contextlib.suppress(BrokenPipeError):
            stdin.write(f"{steps}\n")
            stdin.flush()
        found = stdout.readline()
        if not found:
            self._process.wait()
            self._output.seek(0)
            raise RuntimeError(self._output.read().strip()[-2000:])
        return found


def main() -> None:
    """Serve."""
    name, fmu, n = sys.argv[1:]
    # what libraries print must not pass for an answer
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    prepare = PEERS[name].prepare
    if prepare is None:
        raise SystemExit(f"{name} is installed, but not driven here")
    driven = prepare(fmu, int(n))
    for line in sys.stdin:
        began = time.perf_counter_ns()
        if int(line):
            driven.go(int(line))
            answers.write(f"{time.perf_counter_ns() - began}\n")
        else:
            answers.write(f"{driven.value()!r}\n")
        answers.flush()


if __name__ == "__main__":
    main()
