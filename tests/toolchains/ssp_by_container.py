"""FMUContainer of the FMU Manipulation Toolbox packs the archive into one FMU.

It takes elements and connections, not parameters. FMPy steps the container from outside.
"""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

from fmu_manipulation_toolbox.assembly import Assembly
from toolchains import by_fmpy
from toolchains.flight import Flight, Part
from toolchains.ssp_flight import Archive, Rows, label, serve


def fly(archive: Archive) -> Rows:
    """Pack, then let FMPy step the container."""
    logging.disable(logging.WARNING)
    folder = Path("parts")
    folder.mkdir()
    shutil.copy(archive.ssp, folder / "system.ssp")
    assembly = Assembly("system.ssp", fmu_directory=folder, step_size=archive.step)
    root = assembly.root
    assert root is not None
    files = {p.name: p for p in (folder / "system.dir").iterdir()}
    assert files
    named = {}
    for i, (element, variable) in enumerate(archive.watch):
        fmu = next(n for n in root.fmu_names_list if _is_of(archive, element, n))
        root.add_output(fmu, variable, f"row_{i}")
        named[f"row_{i}"] = (element, variable)
    assembly.make_fmu(fmi_version=2)
    rows = by_fmpy.fly(
        Flight(
            parts={"container": Part(str(folder / "system.fmu"), {})},
            wires=(),
            step_ns=archive.step_ns,
            steps=archive.steps,
            watch=tuple(("container", row) for row in named),
        )
    )
    return {label(*watched): rows[label("container", row)] for row, watched in named.items()}


def _is_of(archive: Archive, element: str, fmu: str) -> bool:
    from lxml import etree  # noqa: PLC0415
    import zipfile  # noqa: PLC0415

    ssd = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
    with zipfile.ZipFile(archive.ssp) as packed:
        root = etree.fromstring(packed.read("SystemStructure.ssd"))
    source = next(c.get("source") for c in root.iter(f"{ssd}Component") if c.get("name") == element)
    return Path(source).name == Path(fmu).name


if __name__ == "__main__":
    serve(fly)
