"""Builds the FMU of scalar.c, and systems of several of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from compiled import compile_fmu

from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, Endpoint, Link, System, make_schedule

_VARIABLES = (
    ("u", "input", "continuous", '<Real start="0"/>'),
    ("x", "output", "continuous", "<Real/>"),
    ("y", "output", "continuous", "<Real/>"),
    ("a", "parameter", "tunable", '<Real start="-1"/>'),
    ("b", "parameter", "tunable", '<Real start="1"/>'),
    ("x0", "parameter", "fixed", '<Real start="0"/>'),
    ("c", "parameter", "fixed", '<Real start="1"/>'),
    ("e", "parameter", "fixed", '<Real start="0"/>'),
    ("g", "parameter", "fixed", '<Real start="0"/>'),
)


def scalar_fmu(
    folder: Path, *, variable_step: bool = True, states: bool = True, declared: bool = True
) -> Path:
    """scalar.fmu, compiled by the system's compiler, with or without two capabilities.

    `declared` : whether it says which outputs depend on the input.
    """
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}">{kind}</ScalarVariable>'
        for i, (name, causality, variability, kind) in enumerate(_VARIABLES)
    )
    outputs = '<Unknown index="2" dependencies=""/><Unknown index="3" dependencies="1"/>'
    initial = '<Unknown index="2" dependencies="1"/><Unknown index="3" dependencies="1"/>'
    if not declared:
        outputs = outputs.replace(' dependencies=""', "").replace(' dependencies="1"', "")
    flags = {
        "canHandleVariableCommunicationStepSize": variable_step,
        "canGetAndSetFMUstate": states,
        "canSerializeFMUstate": states,
    }
    written = " ".join(f'{name}="{str(value).lower()}"' for name, value in flags.items())
    description = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="2.0" modelName="scalar" guid="scalar">'
        f'<CoSimulation modelIdentifier="scalar" {written}/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs>"
        f"<InitialUnknowns>{initial}</InitialUnknowns></ModelStructure></fmiModelDescription>\n"
    )
    path = folder / f"scalar-{variable_step:d}{states:d}{'' if declared else '-undeclared'}.fmu"
    return compile_fmu(Path(__file__).with_name("scalar.c"), description, path)


def ns(seconds: float) -> int:
    """Convert seconds to nanoseconds."""
    return round(seconds * 1e9)


def end(text: str) -> Endpoint:
    """plant.x -> Endpoint("plant", "x")."""
    component, _, variable = text.partition(".")
    return Endpoint(component, variable)


def scalars(
    fmu: Path,
    parameters: Mapping[str, Mapping[str, float]],
    connections: Sequence[tuple[str, ...]],
    *,
    step: float,
    stop: float,
    links: Sequence[Link] = (),
    every: Mapping[str, float] | None = None,
    events: Any = "align",
    **more: Any,
) -> System:
    """A system of scalars by name; connections are (from, to[, link[, policy]])."""
    named = {link.name: link for link in links}
    own = {name: ns(seconds) for name, seconds in (every or {}).items()}
    comm_schedule = make_schedule(named, ns(step), ns(stop), events, own.values())
    described = describe_fmu(fmu)
    return System(
        {name: Component(described, given, own.get(name)) for name, given in parameters.items()},
        [
            Connection(end(c[0]), end(c[1]), *(part or None for part in c[2:3]), *c[3:])
            for c in connections
        ],
        named,
        {},
        comm_schedule,
        1e6,
        **more,
    )
