"""FMI variables of the state feedback: HinfController for the vehicle, PaperController."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cosim.models.auv import STATE, TABLE_1, inertia
from cosim.models.paper_example import PRINTED_K
from fmu_src.spec import ComponentSpec, Variable

DEFAULT_GAIN = (-0.06, -0.53)
"""Start values of K on position and on speed; a design replaces them (HinfController)."""

_SOURCES = (
    "cosim.models.products",
    "cosim.models.feedback",
    "fmu_src.hinf_controller.behaviour",
)
_BEHAVIOUR = "fmu_src.hinf_controller.behaviour:StateFeedback"
_README = Path(__file__).with_name("readme.md")
_FORCE = (("force.x", "N"), ("force.y", "N"), ("force.z", "N"), ("moment.z", "N.m"))
_UNITS = ("m", "m", "m", "rad", "m/s", "m/s", "m/s", "rad/s")


def _gain(K: Sequence[Sequence[float]]) -> list[Variable]:
    return [
        Variable(
            f"K[{i},{j}]", "parameter", f"gain of command {i} on state {j}, u = K x", None, value
        )
        for i, row in enumerate(K, 1)
        for j, value in enumerate(row, 1)
    ]


def _sample_time(start: float) -> Variable:
    return Variable(
        "sample_time",
        "parameter",
        "sampling period; 0 samples at every communication point",
        "s",
        start,
        minimum=0.0,
    )


def _vehicle() -> ComponentSpec:
    table = [
        Variable(name, "input", f"measured {name}", unit, discrete=False)
        for name, unit in zip(STATE, _UNITS, strict=True)
    ]
    reference = [f"reference.{axis}" for axis in ("x", "y", "z", "psi")]
    table += [
        Variable(name, "input", f"set point of eta.{name.removeprefix('reference.')}", unit)
        for name, unit in zip(reference, _UNITS, strict=False)
    ]
    table += [
        Variable(name, "output", f"commanded {name}, held between samples", unit, discrete=True)
        for name, unit in _FORCE
    ]
    position, speed = DEFAULT_GAIN
    K = [[position if j == i else speed if j == i + 4 else 0.0 for j in range(8)] for i in range(4)]
    table += _gain(K)
    table += [
        Variable(
            f"thrust_map[{i},{j}]",
            "parameter",
            f"force or moment {i} per commanded acceleration {j} (mass matrix of Eq. (3))",
            None,
            float(value),
        )
        for i, row in enumerate(inertia(TABLE_1), 1)
        for j, value in enumerate(row, 1)
    ]
    table += [
        Variable(
            "limit.force", "parameter", "largest thrust along each axis", "N", 2500.0, minimum=0.0
        ),
        Variable("limit.moment", "parameter", "largest moment", "N.m", 2500.0, minimum=0.0),
        _sample_time(0.05),
    ]
    return ComponentSpec(
        name="HinfController",
        description="Sampled H-infinity state feedback of the vehicle, Eq. (8), with thrust limits",
        variables=tuple(table),
        behaviour=_BEHAVIOUR,
        sources=_SOURCES,
        readme=_README,
        stop_time=60.0,
        step_size=0.05,
        constants={
            "measured": list(STATE),
            "reference": [*reference, None, None, None, None],
            "outputs": [name for name, _ in _FORCE],
            "limits": ["limit.force", "limit.force", "limit.force", "limit.moment"],
            "mapped": True,
        },
    )


def feedback_spec(
    name: str, K: Sequence[Sequence[float]], *, description: str, sample_time: float, stop: float
) -> ComponentSpec:
    """A controller u = K x for a system in the letters of Eq. (7), K of shape (m, n)."""
    m, n = len(K), len(K[0])
    measured = [f"x[{j}]" for j in range(1, n + 1)]
    outputs = [f"u[{i}]" for i in range(1, m + 1)]
    table = [Variable(x, "input", f"measured state {x}") for x in measured]
    table += [
        Variable(u, "output", f"command {u}, held between samples", discrete=True) for u in outputs
    ]
    table += [*_gain(K), _sample_time(sample_time)]
    return ComponentSpec(
        name=name,
        description=description,
        variables=tuple(table),
        behaviour=_BEHAVIOUR,
        sources=_SOURCES,
        readme=_README,
        stop_time=stop,
        step_size=0.01,
        constants={
            "measured": measured,
            "reference": [None] * n,
            "outputs": outputs,
            "limits": [],
            "mapped": False,
        },
    )


SPEC = _vehicle()
PAPER_SPEC = feedback_spec(
    "PaperController",
    [PRINTED_K],
    description="Sampled state feedback of the paper's section 5 with its printed gain",
    sample_time=0.0,
    stop=10.0,
)
