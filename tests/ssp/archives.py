"""Archives of SSP as tests write them, and runs of scenarios to compare."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.master import Run, simulate
from cosim.scenario import (
    FmuCache,
    LoadedScenario,
    SspExport,
    assembled_system,
    export_ssp,
    parse,
    prepare,
)

Links = Literal["annotate", "fmu"]
"""How an archive has the links: as annotations, or as FMUs."""

SSP1 = "http://ssp-standard.org/SSP1/SystemStructure"
"""Begin of the namespaces of SSP."""

SPACES = " ".join(
    f'xmlns:{prefix}="{SSP1}{name}"'
    for prefix, name in (
        ("ssc", "Common"),
        ("ssd", "Description"),
        ("ssv", "ParameterValues"),
        ("ssm", "ParameterMapping"),
    )
)

LINKED = """
title = "Section 5 over two links"
[run]
end = 2.0
step = 0.01
seed = 5
events = "{events}"
[components.plant]
fmu = "DelayedPlant"
[components.plant.parameters]
"delay.d" = 0.21
[components.controller]
fmu = "PaperController"
[components.controller.parameters]
"x[1]" = 9.0
[components.exosystem]
fmu = "WaveField"
[components.exosystem.parameters]
spectrum = 0
"omega[1]" = 4.0
"amplitude[1]" = 1.0
[[connections]]
from = "exosystem.disturbance.u"
to = "plant.w[1]"
[[connections]]
from = "plant.x"
to = "controller.x"
link = "up-link"
[[connections]]
from = "controller.u"
to = "plant.u"
link = "downlink"
[links.up-link]
kind = "packet"
sample_time = 0.03
delay = 0.025
jitter = {{ kind = "normal", mean = 0.02, sigma = 0.02 }}
loss = {{ p_enter = 0.1, p_exit = 0.4 }}
order = "as-arrived"
on_loss = "zero"
quantization = 1e-3
playout = 0.07
data_rate = 9600
frame_size = 80
[links.downlink]
kind = "transport"
delay = 0.034
"""


def loaded(text: str, folder: Path, name: str = "test") -> LoadedScenario:
    return parse(text, name=name, where=f"{name}.toml", folder=folder)


def export(
    text: str, fmus: Path, folder: Path, links: Links = "annotate", name: str = "test"
) -> SspExport:
    """The archive of a scenario, its built-in FMUs native."""
    prepared = prepare(loaded(text, folder, name), FmuCache(fmus.parent, folder, flavour="native"))
    return export_ssp(prepared, folder / f"{name}.ssp", links)


def execute_scenario(scenario: LoadedScenario, fmus: Path) -> Run:
    prepared = prepare(scenario, FmuCache(fmus.parent, scenario.folder, flavour="native"))
    run = simulate(assembled_system(prepared)[0])
    assert run.status == "finished", run.reason
    return run


def signals(run: Run, *names: str) -> dict[str, NDArray[np.float64]]:
    return {name: run.signal(*name.split(".", 1)) for name in names}


def ssd(system: str, more: str = "", name: str = "foreign") -> str:
    """A SystemStructure.ssd around the content of its system."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<ssd:SystemStructureDescription {SPACES} '
        f'version="1.0" name="{name}">\n<ssd:System name="root">\n{system}\n</ssd:System>\n'
        f"{more}</ssd:SystemStructureDescription>\n"
    )


def write(path: Path, entries: Mapping[str, str | bytes]) -> Path:
    """A zip of these entries."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in entries.items():
            packed.writestr(name, content)
    return path


def component(name: str, fmu: str, inputs: str = "", outputs: str = "", inside: str = "") -> str:
    """A component with Real connectors; names separated by blanks."""
    connectors = "".join(
        f'<ssd:Connector name="{c}" kind="{kind}"><ssc:Real/></ssd:Connector>'
        for kind, listed in (("input", inputs), ("output", outputs))
        for c in listed.split()
    )
    listed = f"<ssd:Connectors>{connectors}</ssd:Connectors>" if connectors else ""
    return f'<ssd:Component name="{name}" source="{fmu}">{listed}{inside}</ssd:Component>\n'


def connection(a: str, b: str, inside: str = "", more: str = "") -> str:
    """`element:connector`, or `:connector` of the system itself."""
    words = []
    for side, end in (("start", a), ("end", b)):
        element, _, connector = end.partition(":")
        words += [f'{side}Element="{element}"'] * bool(element)
        words.append(f'{side}Connector="{connector}"')
    return f"<ssd:Connection {' '.join(words)} {more}>{inside}</ssd:Connection>\n"
