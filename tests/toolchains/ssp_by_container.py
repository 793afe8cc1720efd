"""FMUContainer of the FMU Manipulation Toolbox packs the archive into one FMU.

It takes elements and connections, not parameters. FMPy steps the container from outside.
"""

from __future__ import annotations

import logging
import shutil
import zipfile
from pathlib import Path

from fmu_manipulation_toolbox.assembly import Assembly
from lxml import etree
from toolchains import by_fmpy
from toolchains.peer_run import Part, PeerRun
from toolchains.ssp_peer_run import Archive, Rows, label, serve

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"


def run_tool(archive: Archive) -> Rows:
    """Pack, then let FMPy step the container."""
    logging.disable(logging.WARNING)
    folder = Path("parts")
    folder.mkdir()
    shutil.copy(archive.ssp, folder / "system.ssp")
    assembly = Assembly("system.ssp", fmu_directory=folder, default_step_size=archive.step)
    root = assembly.root
    assert root is not None
    fmus = {Path(name).name: name for name in root.fmu_names_list}
    sources = _sources(archive.ssp)
    named = {}
    for i, (element, variable) in enumerate(archive.watch):
        fmu = fmus[Path(sources[element]).name]
        root.add_output(fmu, variable, f"row_{i}")
        named[f"row_{i}"] = (element, variable)
    assembly.make_fmu(fmi_version=2)
    rows = by_fmpy.run_tool(
        PeerRun(
            parts={"container": Part(str(folder / "system.fmu"), {})},
            wires=(),
            step_ns=archive.step_ns,
            steps=archive.steps,
            watch=tuple(("container", row) for row in named),
        )
    )
    return {label(*watched): rows[label("container", row)] for row, watched in named.items()}


def _sources(ssp: str) -> dict[str, str]:
    """The FMU of each element."""
    with zipfile.ZipFile(ssp) as packed:
        root = etree.fromstring(packed.read("SystemStructure.ssd"))
    return {c.get("name"): c.get("source") for c in root.iter(f"{SSD}Component")}


if __name__ == "__main__":
    serve(run_tool)
