"""FMI variables of the state feedback: HinfController for the vehicle, PaperController.

The gain of HinfController is that of the design `auv-1.25s`, which the built-in scenarios use;
`paper.json` beside this file is the certificate of the gain printed in section 5.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from cosim.fmu import ComponentSpec, Variable, component_module, loop_scenario
from cosim.models import STATE, TABLE_1, inertia

_VEHICLE = component_module("auv_plant.variables")
LIMITS = (2500.0, 2500.0)
"""Largest thrust along each axis [N] and largest moment [N m] of the vehicle."""

_SOURCES = (
    "cosim.models.products",
    "cosim.models.feedback",
    "cosim.components.hinf_controller.behaviour",
)
_BEHAVIOUR = "cosim.components.hinf_controller.behaviour:StateFeedback"
_README = Path(__file__).with_name("readme.md")
_FORCE = (("force.x", "N"), ("force.y", "N"), ("force.z", "N"), ("moment.z", "N.m"))
_STEP = 0.01  # [s], of the default experiment

_VEHICLE_NOTES = """
## From accelerations to forces

The state is x = (`eta`, `nu`), and u is an acceleration. The outputs are M u =
(`force.x`, `force.y`, `force.z`, `moment.z`), each limited to ± `limit.force` and
± `limit.moment`. M, the parameter `thrust_map`, is the mass matrix of the vehicle, added mass
included.
"""


def _gain(K: Sequence[Sequence[float]]) -> list[Variable]:
    return [
        Variable(
            f"K[{i},{j}]", "parameter", f"gain of command {i} on state {j}, u = K x", None, value
        )
        for i, row in enumerate(K, 1)
        for j, value in enumerate(row, 1)
    ]


def _sample_time(start: float) -> Variable:
    text = "sampling period; 0 samples at every communication point"
    return Variable("sample_time", "parameter", text, "s", start, minimum=0.0)


def _limits(values: Sequence[float]) -> list[Variable]:
    force, moment = values
    text = "largest thrust along each axis"
    return [
        Variable("limit.force", "parameter", text, "N", force, minimum=0.0),
        Variable("limit.moment", "parameter", "largest moment", "N.m", moment, minimum=0.0),
    ]


def vehicle_spec(
    name: str,
    certificate: bytes,
    *,
    sample_time: float = 0.05,
    limits: Sequence[float] = LIMITS,
    controller: str | None = None,
) -> ComponentSpec:
    """Specify a controller of the vehicle with the gain (4, 8) that `certificate` proves.

    `limits` are of each thrust [N] and of the moment [N m], `sample_time` is in [s], `controller`
    is the FMU in the page's example, by default NAME.fmu.
    """
    table = [
        Variable(name, "input", f"measured {name}", unit, discrete=False)
        for name, unit in zip(STATE, _VEHICLE.STATE_UNITS, strict=True)
    ]
    reference = [f"reference.{axis}" for axis in ("x", "y", "z", "psi")]
    table += [
        Variable(name, "input", f"set point of eta.{name.removeprefix('reference.')}", unit)
        for name, unit in zip(reference, _VEHICLE.STATE_UNITS, strict=False)
    ]
    table += [
        Variable(name, "output", f"commanded {name}, held between samples", unit, discrete=True)
        for name, unit in _FORCE
    ]
    table += _gain(json.loads(certificate)["K"])
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
    table += [*_limits(limits), _sample_time(sample_time)]
    return ComponentSpec(
        name=name,
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
        certificate=certificate,
        notes=_VEHICLE_NOTES,
        scenario=_VEHICLE.vehicle_scenario("Station keeping", controller or f"{name}.fmu"),
    )


def feedback_spec(
    name: str,
    certificate: bytes,
    *,
    description: str,
    sample_time: float = 0.0,
    limits: Sequence[float] = (),
    stop: float = 10.0,
    plant: str = "plant.fmu",
    controller: str | None = None,
) -> ComponentSpec:
    """Specify a controller u = K x for a system in the form of Eq. (7).

    Its gain (m, n) is the one that `certificate` proves; `limits` has one bound per command, or
    none. `plant` and `controller` (by default NAME.fmu) are the FMUs in the page's example.
    """
    proved = json.loads(certificate)
    K, delays = proved["K"], proved["claim"]["delays"]
    m, n = len(K), len(K[0])
    measured = [f"x[{j}]" for j in range(1, n + 1)]
    outputs = [f"u[{i}]" for i in range(1, m + 1)]
    table = [Variable(x, "input", f"measured state {x}") for x in measured]
    table += [
        Variable(u, "output", f"command {u}, held between samples", discrete=True) for u in outputs
    ]
    table += _gain(K)
    table += [
        Variable(f"limit.{u}", "parameter", f"largest command {u}", None, value, minimum=0.0)
        for u, value in zip(outputs if limits else (), limits, strict=True)
    ]
    table.append(_sample_time(sample_time))
    return ComponentSpec(
        name=name,
        description=description,
        variables=tuple(table),
        behaviour=_BEHAVIOUR,
        sources=_SOURCES,
        readme=_README,
        stop_time=stop,
        step_size=_STEP,
        constants={
            "measured": measured,
            "reference": [None] * n,
            "outputs": outputs,
            "limits": [f"limit.{u}" for u in outputs] if limits else [],
            "mapped": False,
        },
        certificate=certificate,
        notes=_feedback_notes(m, n, with_limits=bool(limits)),
        scenario=loop_scenario(
            plant,
            controller or f"{name}.fmu",
            feedback_delay=max((d["d"] for d in delays if d["feedback"]), default=0.0),
            step=_STEP,
            end=stop,
        ),
    )


def _feedback_notes(m: int, n: int, *, with_limits: bool) -> str:
    bounds = ", each limited to ± `limit.u[i]`" if with_limits else ", without limits"
    return (
        "\n## This controller\n\nFor a system in the form of Eq. (7): "
        f"{n} measured state{'s' * (n != 1)} `x[j]`, {m} command{'s' * (m != 1)} `u[i]`{bounds}.\n"
    )


def _designed(name: str) -> bytes:
    """Return the certificate of a packaged design, as `cosim.hinf.certificate_bytes` but faster."""
    file = files("cosim").joinpath("scenario", "library", "designs", f"{name}.json")
    design = json.loads(file.read_bytes())
    del design["figures"]
    return json.dumps(design, sort_keys=True, separators=(",", ":")).encode() + b"\n"


SPEC = vehicle_spec("HinfController", _designed("auv-1.25s"), controller="HinfController")
PAPER_SPEC = feedback_spec(
    "PaperController",
    Path(__file__).with_name("paper.json").read_bytes(),
    description="Sampled state feedback of the paper's section 5 with its printed gain",
    plant="DelayedPlant",
    controller="PaperController",
)
