"""Two tiny FMUs in C, made on the spot: what is left of their run is the master's cost."""

from __future__ import annotations

import sys
from pathlib import Path

if __package__ == "tests.benchmarks":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from compiled import compile_fmu

_SOURCE = Path(__file__).with_name("tiny.c")


def tiny_fmu(signals: int, folder: Path) -> Path:
    """tinyN.fmu with N inputs u[i] and N outputs x[i], compiled by the system's compiler."""
    name = f"tiny{signals}"
    outputs = [f'<Unknown index="{i + 1}" dependencies=""/>' for i in range(signals)]
    variables = [
        f'<ScalarVariable name="x[{i + 1}]" valueReference="{i}" causality="output" '
        'variability="continuous" initial="exact"><Real start="1"/></ScalarVariable>'
        for i in range(signals)
    ]
    variables += [
        f'<ScalarVariable name="u[{i + 1}]" valueReference="{signals + i}" causality="input" '
        'variability="continuous"><Real start="0"/></ScalarVariable>'
        for i in range(signals)
    ]
    description = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">'
        f'<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure><Outputs>{''.join(outputs)}</Outputs>"
        f"<InitialUnknowns>{''.join(outputs)}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>\n"
    )
    flags = ("-O2", f"-DN={signals}")
    return compile_fmu(_SOURCE, description, folder / f"{name}.fmu", *flags)
