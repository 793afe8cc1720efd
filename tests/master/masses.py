"""The two-mass oscillator, the standard test of co-simulation: FMU, system, exact solution."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from compiled import compile_fmu
from master.scalar import end, ns
from numpy.typing import NDArray
from scipy.linalg import expm

from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, System, make_schedule

_VARIABLES = (
    ("u1", "input", "continuous", 'start="0"'),
    ("u2", "input", "continuous", 'start="0"'),
    ("x", "output", "continuous", 'start="0"'),
    ("v", "output", "continuous", 'start="0"'),
    ("f", "output", "continuous", ""),
    *((name, "parameter", "fixed", f'start="{v}"') for name, v in (("m", 1), ("c", 0), ("d", 0))),
    *((name, "parameter", "fixed", 'start="0"') for name in ("c12", "d12", "side")),
)
_EXACT = ' initial="exact"'
MASS, SPRING, DAMPER, COUPLING, COUPLING_DAMPER = 1.0, (1.0, 2.0), (0.1, 0.1), 1.5, 0.2
START = (0.1, 0.1, 0.2, 0.1)
"""Position and speed of the left mass, then of the right one."""


def mass_fmu(folder: Path) -> Path:
    """masses.fmu, compiled by the system's compiler."""
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}"{_EXACT if start and causality == "output" else ""}>'
        f"<Real {start}/></ScalarVariable>"
        for i, (name, causality, variability, start) in enumerate(_VARIABLES)
    )
    unknowns = "".join(f'<Unknown index="{i}" dependencies=""/>' for i in (3, 4))
    force = '<Unknown index="5" dependencies="1 2"/>'
    description = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="2.0" modelName="masses" guid="masses">'
        '<CoSimulation modelIdentifier="masses" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}{force}</Outputs>"
        f"<InitialUnknowns>{force}</InitialUnknowns></ModelStructure></fmiModelDescription>\n"
    )
    return compile_fmu(Path(__file__).with_name("masses.c"), description, folder / "masses.fmu")


def oscillator(fmu: Path, policy: Any, *, step: float, stop: float) -> System:
    """Force and displacement coupling of two masses."""
    described = describe_fmu(fmu)
    given = {"m": MASS, "c12": COUPLING, "d12": COUPLING_DAMPER}
    left = {"c": SPRING[0], "d": DAMPER[0], "x": START[0], "v": START[1], "side": 0.0}
    right = {"c": SPRING[1], "d": DAMPER[1], "x": START[2], "v": START[3], "side": 1.0}
    pairs = (("right.f", "left.u1"), ("left.x", "right.u1"), ("left.v", "right.u2"))
    return System(
        {"left": Component(described, given | left), "right": Component(described, given | right)},
        [Connection(end(s), end(t), None, policy) for s, t in pairs],
        {},
        {},
        make_schedule({}, ns(step), ns(stop), "grid"),
        1e6,
    )


def exact(time_s: float) -> NDArray[np.float64]:
    """Positions and speeds of both masses."""
    c, d = COUPLING, COUPLING_DAMPER
    matrix = [
        [0, 1, 0, 0],
        [-(SPRING[0] + c), -(DAMPER[0] + d), c, d],
        [0, 0, 0, 1],
        [c, d, -(SPRING[1] + c), -(DAMPER[1] + d)],
    ]
    found: NDArray[np.float64] = expm(time_s * np.array(matrix) / MASS) @ START
    return found
