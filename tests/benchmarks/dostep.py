"""What one doStep of the native AuvPlant costs, against a loop written by hand, and Python.

* by hand: a C loop of the same method on the same equations, step and delay given at run time;
  compiled with the options of the FMU; held to the FMU's own result;
* native: fmi2DoStep from C, for inputs that are held and for inputs that jump at every step;
* python: the pythonfmu flavour through fmpy, beside the native flavour through fmpy.

CPU time, the best of many runs taken in turn. Prints a table, and JSON with --json. Figures are
ratios; the nanoseconds beside them hold for this machine alone. No Python FMU of the
project runs outside a Python host, so its doStep is timed where it can be.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from lxml import etree
from rich.console import Console
from rich.table import Table

from cosim.fmu.export import ensure_fmu, host
from tests.c_compiler import c_compiler

NAME, STEP, DELAY, STEPS = "AuvPlant", 0.05, 0.5, 1000
FORCE = ("force.x", "force.y", "force.z", "moment.z")
SOURCE = Path(__file__).with_suffix(".c")


def options_of(path: Path) -> list[str]:
    """The options of the compiler by the build description of an FMU (FMI 3.0)."""
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read("sources/buildDescription.xml"))
    options: str = next(root.iter("SourceFileSet")).get("compilerOptions")
    return options.split()


def in_c(native: Path, options: list[str], folder: Path) -> dict[str, dict[str, float]]:
    """Nanoseconds per step in C, by case: hand, native, setting; and how far apart they end."""
    unpacked = Path(fmpy.extract(str(native), unzipdir=str(folder / "unpacked")))
    program = folder / "dostep"
    subprocess.run(  # noqa: S603 - a compiler, on our own source
        [
            *(*c_compiler(), *options, "-D_DEFAULT_SOURCE", f"-I{unpacked / 'sources'}"),
            *(str(SOURCE), "-o", str(program), "-ldl", "-lm"),
        ],
        check=True,
    )
    model = fmpy.read_model_description(str(native))
    reference = {v.name: str(v.valueReference) for v in model.modelVariables}
    states = [v.name for v in model.modelVariables if v.causality == "output"]
    library = unpacked / "binaries" / host().fmi2 / f"{NAME}{host().suffix}"
    done = subprocess.run(  # noqa: S603 - built above
        [
            *(str(program), str(library), model.guid, str(STEP), str(DELAY)),
            *(reference[name] for name in (*FORCE, *states)),
        ],
        check=True,
        capture_output=True,
        text=True,
    )
    figures = {}
    for case, line in zip(("held", "moving"), done.stdout.splitlines(), strict=True):
        hand, fmu, setting, apart = map(float, line.split())
        if apart > 1e-9:
            raise SystemExit(f"the loop by hand ends {apart:g} away from the FMU: not the same")
        figures[case] = {
            "by_hand_ns": 1e9 * hand,
            "native_ns": 1e9 * fmu,
            "set_real_ns": 1e9 * setting,
            "native_over_by_hand": fmu / hand,
            "apart": apart,
        }
    return figures


def through_fmpy(path: Path) -> float:
    """Nanoseconds per doStep as fmpy calls it, inputs held; the best of five runs."""
    model = fmpy.read_model_description(str(path))
    slave = FMU2Slave(
        guid=model.guid,
        unzipDirectory=fmpy.extract(str(path)),
        modelIdentifier=model.coSimulation.modelIdentifier,
        instanceName=path.parent.name,
    )
    slave.instantiate()
    best = float("inf")
    for _ in range(5):
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        begin = time.process_time()
        for k in range(STEPS):
            slave.doStep(currentCommunicationPoint=k * STEP, communicationStepSize=STEP)
        best = min(best, time.process_time() - begin)
        slave.reset()
    slave.freeInstance()
    return 1e9 * best / STEPS


def main() -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory(prefix="cosim-bench-") as name:
        folder = Path(name)
        native = ensure_fmu(NAME, folder, flavour="native").path
        python = ensure_fmu(NAME, folder, flavour="python").path
        options = options_of(ensure_fmu(NAME, folder, flavour="native-fmi3").path)
        cases = in_c(native, options, folder)
        python_ns, fmpy_ns = through_fmpy(python), through_fmpy(native)
    figures = {
        **cases,
        "python_through_fmpy_ns": python_ns,
        "native_through_fmpy_ns": fmpy_ns,
        "python_over_native": python_ns / cases["held"]["native_ns"],
        "python_over_native_through_fmpy": python_ns / fmpy_ns,
    }
    if "--json" in sys.argv:
        print(json.dumps(figures, indent=2))
        return
    table = Table(title=f"one doStep of {NAME}, {STEP} s, delay {DELAY} s")
    for column in ("", "by hand", "native FMU", "ratio", "fmi2SetReal before it"):
        table.add_column(column, justify="left" if not column else "right")
    for case, f in cases.items():
        table.add_row(
            f"inputs {case}",
            f"{f['by_hand_ns']:.0f} ns",
            f"{f['native_ns']:.0f} ns",
            f"{f['native_over_by_hand']:.2f}",
            f"{f['set_real_ns']:.0f} ns",
        )
    console = Console()
    console.print(table)
    console.print(
        f"python flavour: {python_ns / 1e3:.1f} us, {figures['python_over_native']:.0f} times the "
        f"native doStep ({figures['python_over_native_through_fmpy']:.0f} times, both through fmpy)"
    )


if __name__ == "__main__":
    main()
