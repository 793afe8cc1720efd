"""One coupled run as plain data, executed by a foreign tool in a process of its own.

Every tool stands in `TOOLS` and has a file `by_NAME.py` beside this one: a function from a
`PeerRun` to the rows of every watched variable, and a last line `serve(run_tool)`. A tool runs in
its own process because each loads native code, prints what it likes, and must not end the tests
when it falls.

The coupling is the same in all: at each point the outputs are read, then handed to the inputs,
then every FMU steps (Jacobi), the first hand-over being of the outputs after initialisation.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest
from fmpy import read_model_description
from numpy.typing import NDArray

Rows = Mapping[str, list[float]]
HERE = Path(__file__).parent
EXTRA = "toolchains"


class Tool(NamedTuple):
    """A foreign tool: the modules it needs, the versions of FMI that it takes."""

    file: str
    modules: tuple[str, ...]
    versions: tuple[str, ...]


TOOLS = MappingProxyType(
    {
        "fmpy": Tool("by_fmpy", ("fmpy",), ("2", "3")),
        "libcosim": Tool("by_libcosim", ("libcosimpy",), ("2",)),
        "ecos": Tool("by_ecos", ("ecospy", "tbb"), ("2", "3")),
        "container": Tool("by_container", ("fmu_manipulation_toolbox",), ("2", "3")),
    }
)


@dataclass(frozen=True)
class Part:
    """An FMU and its start values; an int is an Integer, a float a Real."""

    fmu: str
    parameters: Mapping[str, float | int]


@dataclass(frozen=True)
class PeerRun:
    """The run that a tool executes.

    Attributes
    ----------
    parts : by name.
    wires : (part, output, part, input), Real.
    step_ns, steps : communication step [ns] and their number.
    watch : (part, Real output), in the order of the rows.
    again : whether the tool resets every part after the run and runs once more: those rows count.
    """

    parts: Mapping[str, Part]
    wires: tuple[tuple[str, str, str, str], ...]
    step_ns: int
    steps: int
    watch: tuple[tuple[str, str], ...]
    again: bool = False

    @property
    def step(self) -> float:
        """The communication step [s]."""
        return self.step_ns / 1e9

    def references(self, part: str) -> Mapping[str, int]:
        """Value references of a part by name."""
        model = read_model_description(self.parts[part].fmu, validate=False)
        return {v.name: v.valueReference for v in model.modelVariables}


def label(part: str, variable: str) -> str:
    """The name of a row."""
    return f"{part}.{variable}"


def run_peer(tool: Tool, peer_run: PeerRun, folder: Path) -> dict[str, NDArray[np.float64]]:
    """Run with a tool; the test is skipped if the tool is not installed.

    Returns
    -------
    Label -> value at the end of each step, shape (steps,).
    """
    return answered(tool.file, tool.modules, asdict(peer_run), folder)


def skip_without(modules: Sequence[str]) -> None:
    """Skip the test where a tool cannot be had, before what it is to read is made."""
    missing = [name for name in modules if not installed(name)]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: pip install auv-cosim[{EXTRA}]")


def answered(
    file: str, modules: Sequence[str], request: Mapping[str, Any], folder: Path
) -> dict[str, NDArray[np.float64]]:
    """Run a file of this folder in a process of its own; the rows that it answers a request with.

    request : JSON values, `steps` among them; `modules` : what the file needs, or the test is
    skipped.
    """
    skip_without(modules)
    question, answer = folder / "question.json", folder / "answer.json"
    question.write_text(json.dumps(request), "utf-8")
    path = os.pathsep.join([str(HERE.parent), *sys.path])
    done = subprocess.run(  # noqa: S603 - a file of this folder
        [sys.executable, "-m", f"toolchains.{file}", str(question), str(answer)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{file} ended with {done.returncode}:\n{done.stderr}"
    rows = {name: np.array(row) for name, row in json.loads(answer.read_text("utf-8")).items()}
    assert {row.shape for row in rows.values()} == {(request["steps"],)}
    return rows


def installed(name: str) -> bool:
    """Whether a module, or a distribution without one, is there."""
    if find_spec(name) is not None:
        return True
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def serve(run_tool: Callable[[PeerRun], Rows]) -> None:
    """Read the request, run it and write the answer, when a tool's file is run."""

    def run(plain: dict[str, Any]) -> Rows:
        plain["parts"] = {name: Part(**part) for name, part in plain["parts"].items()}
        for key in ("wires", "watch"):
            plain[key] = tuple(tuple(row) for row in plain[key])
        return run_tool(PeerRun(**plain))

    answer_request(run)


def answer_request(run: Callable[[dict[str, Any]], Rows]) -> None:
    """Read the request that `answered` wrote, run it, write the answer and leave."""
    question, answer = map(Path, sys.argv[1:])
    answer.write_text(json.dumps(run(json.loads(question.read_text("utf-8")))), "utf-8")
    # the answer is complete: some tools corrupt the heap while their libraries are unloaded (Ecos
    # with PythonFMU aborts there now and then), which is no finding about our FMUs
    os._exit(0)
