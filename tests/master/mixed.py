"""Builds the FMU of mixed.c."""

from __future__ import annotations

from pathlib import Path

from compiled import compile_fmu

_VARIABLES = (
    ("u", "input", "continuous", '<Real start="0"/>'),
    ("j", "input", "discrete", '<Integer start="0"/>'),
    ("c", "input", "discrete", '<Boolean start="false"/>'),
    ("y", "output", "continuous", "<Real/>"),
    ("n", "output", "discrete", "<Integer/>"),
    ("f", "output", "discrete", "<Boolean/>"),
    ("fail_at", "parameter", "fixed", '<Real start="1e300"/>'),
    ("status", "parameter", "fixed", '<Integer start="3"/>'),
    ("fail_get", "parameter", "fixed", '<Boolean start="false"/>'),
)


def mixed_fmu(folder: Path) -> Path:
    """mixed.fmu, compiled by the system's compiler."""
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}">{kind}</ScalarVariable>'
        for i, (name, causality, variability, kind) in enumerate(_VARIABLES)
    )
    unknowns = '<Unknown index="4" dependencies="1"/>' + "".join(
        f'<Unknown index="{i}" dependencies=""/>' for i in (5, 6)
    )
    description = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="2.0" modelName="mixed" guid="mixed">'
        '<CoSimulation modelIdentifier="mixed" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>\n"
    )
    return compile_fmu(Path(__file__).with_name("mixed.c"), description, folder / "mixed.fmu")
