"""Output feedbacks by hand, packets for them, and the same packets through FMU and equations."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from driven import behaviour_of

from cosim.fmu.export import component_module

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from raw_fmu import RawFmu

    from cosim.fmu.export import ComponentSpec

VARIABLES = component_module("observer.variables")

PLANT = {
    "name": "axis with late damping and a thruster's lag",
    "A": [[0.0, 1.0, 0.0], [0.0, -0.1, 1.0], [0.0, 0.0, -2.0]],
    "B": [[0.0], [0.0], [2.0]],
    "delays": [{"d": 0.5, "A": [[0.0, 0.0, 0.0], [0.0, -0.3, 0.0], [0.0, 0.0, 0.0]]}],
}
FIX = {"name": "fix", "C": [[1.0, 0.0, 0.0]], "d": 1.5, "any_age": True}
SPEED = {"name": "dvl", "C": [[0.0, 1.0, 0.0], [0.0, 1.0, 0.5]], "d": 0.6, "any_age": True}
L_FIX = [[0.5], [0.06], [0.0]]
L_SPEED = [[0.1, 0.0], [0.6, 0.2], [0.0, 0.0]]
CERTIFICATE: dict[str, Any] = {
    "kind": "output-feedback",
    "claim": {"gamma": None, "uncertain": False, "delays": []},
    "plant": PLANT,
    "measurements": [FIX, SPEED],
    "command_age": 0.33,
    "command_any_age": True,
    "K": [[-0.3, -0.9, 0.05]],
    "L": [L_FIX, L_SPEED],
}
"""Not proved: what these tests are about is the arithmetic of its numbers."""


def content(**changed: Any) -> bytes:
    """The certificate as bytes."""
    return json.dumps({**CERTIFICATE, **changed}).encode()


def spec_of(name: str = "Pair", **settings: Any) -> ComponentSpec:
    """Two thrusters on one axis, limited, sampled, with play-out, safe values and a trim."""
    own: dict[str, Any] = {
        "sample_time": 0.2,
        "limits": (0.2, 0.15),
        "safe": (0.05, -0.02),
        "command_delay": 0.13,
        "envelope": {1: 2.0, 2: 0.5},
        "units": ("m", "m/s", "m/s2"),
        "outputs": (("thruster.a", "N"), ("thruster.b", "N")),
        "allocation": ((1.0, 0.7),),
        "trim": (0.01, 0.02),
    }
    found: ComponentSpec = VARIABLES.output_feedback_spec(name, content(), **{**own, **settings})
    return found


def outputs_of(spec: ComponentSpec) -> tuple[list[str], list[str]]:
    """Names of the Real and of the Integer outputs."""
    outputs = [v for v in spec.variables if v.causality == "output"]
    return (
        [v.name for v in outputs if v.kind == "Real"],
        [v.name for v in outputs if v.kind == "Integer"],
    )


def row_of(raw: RawFmu, spec: ComponentSpec) -> list[Any]:
    """Every output of an FMU, as bits."""
    reals, integers = outputs_of(spec)
    whole = raw.fmu.getInteger([raw.reference[name] for name in integers])
    return [*(value.hex() for value in raw.get(*reals)), *whole]


class Equations:
    """The behaviour of a specification, called as the slave in Python calls it."""

    def __init__(self, spec: ComponentSpec, parameters: dict[str, float] | None = None) -> None:
        self.spec, self.behaviour = spec, behaviour_of(spec)
        self.v: dict[str, Any] = {x.name: x.start for x in spec.variables}
        self.v.update(parameters or {})
        self.behaviour.initialise(self.v, 0.0)
        self.notices: list[str] = []

    def step(self, end: float, inputs: dict[str, float]) -> None:
        """Set inputs and advance."""
        self.v.update(inputs)
        self.behaviour.advance(self.v, end)
        notice = self.behaviour.notice() if hasattr(self.behaviour, "notice") else None
        if notice is not None:
            self.notices.append(notice)

    def row(self) -> list[Any]:
        """Every output, as bits."""
        reals, integers = outputs_of(self.spec)
        return [
            *(float(self.v[name]).hex() for name in reals),
            *(int(self.v[name]) for name in integers),
        ]


def drive(
    raw: RawFmu, spec: ComponentSpec, points: Sequence[float], inputs: Iterable[dict[str, float]]
) -> list[list[Any]]:
    """Step an FMU from point to point, each with its inputs; every output after each."""
    rows = []
    for begin, end, values in zip(points, points[1:], inputs, strict=False):
        raw.put(values)
        raw.step(begin, end - begin)
        rows.append(row_of(raw, spec))
    return rows
