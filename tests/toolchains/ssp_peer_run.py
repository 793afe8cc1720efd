"""An SSP archive, run by a foreign tool in a process of its own.

Every tool has a file `ssp_by_NAME.py`: a function from an `Archive` to the rows of what is
watched, and a last line `serve(run_tool)`, as for `toolchains.peer_run`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from toolchains.peer_run import EXTRA, installed

Rows = Mapping[str, list[float]]
HERE = Path(__file__).parent


class Peer(NamedTuple):
    """A tool that loads archives: its file and the modules it needs.

    bound : whether it sets what ParameterBindings say.
    """

    file: str
    modules: tuple[str, ...]
    bound: bool = True


PEERS = MappingProxyType(
    {
        "ecos": Peer("ssp_by_ecos", ("ecospy", "tbb")),
        "libcosim": Peer("ssp_by_libcosim", ("libcosimpy",)),
        "fmpy": Peer("ssp_by_fmpy", ("fmpy",)),
        "container": Peer("ssp_by_container", ("fmu_manipulation_toolbox",), bound=False),
    }
)


@dataclass(frozen=True)
class Archive:
    """The archive that a tool runs.

    Attributes
    ----------
    ssp : the file.
    step_ns, steps : communication step [ns] and their number.
    watch : (element, Real output), in the order of the rows.
    """

    ssp: str
    step_ns: int
    steps: int
    watch: tuple[tuple[str, str], ...]

    @property
    def step(self) -> float:
        """The communication step [s]."""
        return self.step_ns / 1e9


def label(element: str, variable: str) -> str:
    """The name of a row."""
    return f"{element}.{variable}"


def run_peer(peer: Peer, archive: Archive, folder: Path) -> dict[str, NDArray[np.float64]]:
    """Run with a tool; the test is skipped if the tool is not installed.

    Returns
    -------
    Label -> value at the end of each step, shape (steps,).
    """
    missing = [name for name in peer.modules if not installed(name)]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: pip install auv-cosim[{EXTRA}]")
    question, answer = folder / "question.json", folder / "answer.json"
    question.write_text(json.dumps(asdict(archive)), "utf-8")
    done = subprocess.run(  # noqa: S603 - a file of this folder
        [sys.executable, "-m", f"toolchains.{peer.file}", str(question), str(answer)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE.parent), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{peer.file} ended with {done.returncode}:\n{done.stderr}"
    rows = {name: np.array(row) for name, row in json.loads(answer.read_text("utf-8")).items()}
    assert {row.shape for row in rows.values()} == {(archive.steps,)}
    return rows


def serve(run_tool: Callable[[Archive], Rows]) -> None:
    """Read the request, run it and write the answer, when a tool's file is run."""
    question, answer = map(Path, sys.argv[1:])
    plain = json.loads(question.read_text("utf-8"))
    plain["watch"] = tuple(tuple(row) for row in plain["watch"])
    answer.write_text(json.dumps(run_tool(Archive(**plain))), "utf-8")
