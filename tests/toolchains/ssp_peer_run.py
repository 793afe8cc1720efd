"""An SSP archive, run by a foreign tool in a process of its own.

Every tool has a file `ssp_by_NAME.py`: a function from an `Archive` to the rows of what is
watched, and a last line `serve(run_tool)`, as for `toolchains.peer_run`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from toolchains.peer_run import Rows, answer_request, answered, label

__all__ = ["PEERS", "Archive", "Peer", "Rows", "label", "run_peer", "serve"]


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


def run_peer(peer: Peer, archive: Archive, folder: Path) -> dict[str, NDArray[np.float64]]:
    """Run with a tool; the test is skipped if the tool is not installed.

    Returns
    -------
    Label -> value at the end of each step, shape (steps,).
    """
    return answered(peer.file, peer.modules, asdict(archive), folder)


def serve(run_tool: Callable[[Archive], Rows]) -> None:
    """Read the request, run it and write the answer, when a tool's file is run."""

    def run(plain: dict[str, Any]) -> Rows:
        plain["watch"] = tuple(tuple(row) for row in plain["watch"])
        return run_tool(Archive(**plain))

    answer_request(run)
