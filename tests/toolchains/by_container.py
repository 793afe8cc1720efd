"""FMUContainer of the FMU Manipulation Toolbox: the parts in one FMU, coupled in C.

The container's own runtime loads and steps the parts; FMPy, from outside, sees one FMU and
steps that.
"""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path

from fmu_manipulation_toolbox.assembly import Assembly
from toolchains import by_fmpy
from toolchains.peer_run import Part, PeerRun, Rows, label, serve


def run_tool(peer_run: PeerRun) -> Rows:
    """Pack, then let FMPy step the container."""
    logging.disable(logging.WARNING)
    folder = Path("parts")
    folder.mkdir()
    for name, part in peer_run.parts.items():
        shutil.copy(part.fmu, folder / f"{name}.fmu")
    named = {f"row_{i}": watched for i, watched in enumerate(peer_run.watch)}
    description = {
        "name": "container.fmu",
        "fmu": [f"{name}.fmu" for name in peer_run.parts],
        "link": [[f"{a}.fmu", output, f"{b}.fmu", put] for a, output, b, put in peer_run.wires],
        "start": [
            [f"{name}.fmu", variable, value]
            for name, part in peer_run.parts.items()
            for variable, value in part.parameters.items()
        ],
        "output": [[f"{part}.fmu", output, row] for row, (part, output) in named.items()],
        "step_size": peer_run.step,
        **dict.fromkeys(("auto_link", "auto_input", "auto_output", "auto_parameter"), False),
    }
    (folder / "flight.json").write_text(json.dumps(description), "utf-8")
    Assembly("flight.json", fmu_directory=folder).make_fmu(fmi_version=2)
    rows = by_fmpy.run_tool(
        PeerRun(
            parts={"container": Part(str(folder / "container.fmu"), {})},
            wires=(),
            step_ns=peer_run.step_ns,
            steps=peer_run.steps,
            watch=tuple(("container", row) for row in named),
            again=peer_run.again,
        )
    )
    return {label(*watched): rows[label("container", row)] for row, watched in named.items()}


if __name__ == "__main__":
    serve(run_tool)
