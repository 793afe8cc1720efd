"""Builds the FMU of steered.c, of FMI 2.0 or 3.0."""

from __future__ import annotations

from pathlib import Path

from foreign.c_fmu import c_fmu, source_of

CALLS = (
    *("nothing", "make", "step", "get", "set", "enter", "exit", "reset", "save", "terminate"),
    "free",
)
"""The calls by the number that the parameters `call` and `arithmetic` have for them."""
INTEGERS = ("call", "status", "ends", "early", "arithmetic")
NUMBERS = ("at", "until")
VERSIONS = ("2.0", "3.0")


def steered_fmu(folder: Path, version: str, *, guid: str = "steered", more: str = "") -> Path:
    """Build it in `folder`; it changes the arithmetic at once if its GUID begins with c.

    `more` is C that is added at the end.
    """
    description = _fmi2(guid) if version == "2.0" else _fmi3(guid)
    place = folder / f"steered-{version}-{guid}"
    place.mkdir()
    return c_fmu("steered.c", description, place, text=source_of("steered.c") + more)


def parameters(what: str, status: int, at: float = 0.0, **more: float) -> dict[str, float]:
    """Parameters with which a call returns a status from a time on; no last successful time."""
    return {"call": CALLS.index(what), "status": status, "at": at, "until": -1.0} | more


def _fmi2(guid: str) -> str:
    fixed = 'causality="parameter" variability="fixed"'
    lines = ['<ScalarVariable name="x" valueReference="1" causality="output"><Real/>']
    for reference, name in enumerate((*INTEGERS, *NUMBERS), start=2):
        kind = "Integer" if name in INTEGERS else "Real"
        lines.append(
            f'<ScalarVariable name="{name}" valueReference="{reference}" {fixed}>'
            f'<{kind} start="0"/>'
        )
    lines += [
        '<ScalarVariable name="u" valueReference="9" causality="input"><Real start="0"/>',
        '<ScalarVariable name="y" valueReference="10" causality="output"><Real/>',
    ]
    variables = "".join(f"{line}</ScalarVariable>" for line in lines)
    unknowns = "".join(f'<Unknown index="{i}" dependencies=""/>' for i in (1, 10))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="steered" guid="{guid}">'
        '<CoSimulation modelIdentifier="steered" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUstate="true"/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>"
        "</fmiModelDescription>\n"
    )


def _fmi3(guid: str) -> str:
    fixed = 'causality="parameter" variability="fixed"'
    lines = ['<Float64 name="time" valueReference="99" causality="independent"/>']
    lines.append('<Float64 name="x" valueReference="1" causality="output"/>')
    for reference, name in enumerate((*INTEGERS, *NUMBERS), start=2):
        kind = "Int32" if name in INTEGERS else "Float64"
        lines.append(f'<{kind} name="{name}" valueReference="{reference}" {fixed} start="0"/>')
    lines.append('<Float64 name="u" valueReference="9" causality="input" start="0"/>')
    lines.append('<Float64 name="y" valueReference="10" causality="output"/>')
    unknowns = "".join(
        f'<{kind} valueReference="{reference}" dependencies=""/>'
        for kind in ("Output", "InitialUnknown")
        for reference in (1, 10)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="3.0" modelName="steered" instantiationToken="{guid}">'
        '<CoSimulation modelIdentifier="steered" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUState="true"/>'
        f"<ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{unknowns}</ModelStructure></fmiModelDescription>\n"
    )
