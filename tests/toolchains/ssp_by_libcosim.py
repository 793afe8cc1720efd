"""libcosim loads the unpacked archive; its step is the one that the annotation says."""

from __future__ import annotations

import zipfile
from pathlib import Path

from fmpy import read_model_description
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from lxml import etree
from toolchains.ssp_peer_run import Archive, Rows, label, serve

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"


def run_tool(archive: Archive) -> Rows:
    """The algorithm of the archive: fixed steps."""
    log_output_level(CosimLogLevel.WARNING)
    folder = Path("unpacked")
    with zipfile.ZipFile(archive.ssp) as packed:
        packed.extractall(folder)
    execution = CosimExecution.from_ssp_file(ssp_path=str(folder))
    index = {
        execution.slave_infos()[i].name.decode(): execution.slave_infos()[i].index
        for i in range(execution.num_slaves())
    }
    references = _references(folder)
    observer = CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    rows: dict[str, list[float]] = {label(*watched): [] for watched in archive.watch}
    for _ in range(archive.steps):
        assert execution.step(), execution.status()
        for element, variable in archive.watch:
            (value,) = observer.last_real_values(index[element], [references[element][variable]])
            rows[label(element, variable)].append(value)
    assert execution.status().current_time == archive.steps * archive.step_ns
    return rows


def _references(folder: Path) -> dict[str, dict[str, int]]:
    found = {}
    for component in etree.parse(str(folder / "SystemStructure.ssd")).iter(f"{SSD}Component"):
        model = read_model_description(str(folder / component.get("source")), validate=False)
        found[component.get("name")] = {v.name: v.valueReference for v in model.modelVariables}
    return found


if __name__ == "__main__":
    serve(run_tool)
