"""FMI variables of the state feedback: HinfController for the vehicle, PaperController.

The gain of HinfController is that of the design `auv-1.25s`, which the built-in scenarios use;
`paper.json` beside this file is the certificate of the gain printed in section 5.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from cosim.core import InputError
from cosim.fmu.export import ComponentSpec, Variable, component_module, loop_scenario
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


def _gain(K: Sequence[Sequence[float]], columns: Sequence[int]) -> list[Variable]:
    return [
        Variable(
            f"K[{i},{j}]",
            "parameter",
            f"gain of command {i} on state {j}, u = K x",
            None,
            row[j - 1],
        )
        for i, row in enumerate(K, 1)
        for j in columns
    ]


class _Integrals(NamedTuple):
    """What a controller integrates, read from the system of its certificate.

    measured : numbers of the states (from 1) that the controller is told.
    outputs : names of the integrals.
    S : (k, n) they integrate S x, x the measured states.
    columns : of K, those of the measured states and of the integrals.
    anti_windup : (k, m) what the excess of an output over its limit gives back to the integrals.
    """

    measured: list[int]
    outputs: list[str]
    S: list[list[float]]
    columns: list[int]
    anti_windup: list[list[float]]


def _integrals(proved: dict[str, Any], output_map: Sequence[Sequence[float]] | None) -> _Integrals:
    """Return the integrals of a controller; none where the system has none.

    Back-calculation: G = pinv(M K_i) / T, M the output map, with T = |K_x S'| / |K_i|, the time
    constant of the integral action.
    """
    data = proved["system"]
    size, k = len(data["A"]), data.get("integrals", 0)
    n = size - k
    paths = [data.get("feedback", False), *(delay["feedback"] for delay in data["delays"])]
    if not any(isinstance(path, list) for path in paths):
        states = list(range(1, size + 1))
        return _Integrals(states, [], [], states, [])
    # imported for such a controller alone: the built-in ones are described without it
    import numpy as np  # noqa: PLC0415

    fed_back = np.any(
        [np.full(size, path) if isinstance(path, bool) else path for path in paths], 0
    )
    measured = [j for j in range(1, n + 1) if fed_back[j - 1]]
    rows = np.array([data["A"], *(delay["A"] for delay in data["delays"])]).sum(axis=0)[n:, :n]
    K = np.array(proved["K"], dtype=float).reshape(-1, n + k)
    acts = K[:, n:] if output_map is None else np.array(output_map) @ K[:, n:]
    proportional, integral = np.linalg.norm(K[:, :n] @ rows.T), np.linalg.norm(K[:, n:])
    rate = integral / proportional if proportional > 0 else 1.0
    back = np.linalg.pinv(acts) * rate if k else np.zeros((0, len(K)))
    return _Integrals(
        measured,
        [f"xi[{i}]" for i in range(1, k + 1)],
        rows[:, [j - 1 for j in measured]].tolist(),
        [*measured, *range(n + 1, n + k + 1)],
        [[float(f"{value:.6g}") for value in row] for row in back],
    )


def _integral_variables(own: _Integrals) -> list[Variable]:
    text = "integral of what is measured, kept by the controller, held between samples"
    return [Variable(name, "output", text, discrete=True) for name in own.outputs]


def _anti_windup(own: _Integrals) -> list[Variable]:
    return [
        Variable(
            f"anti_windup[{i},{j}]",
            "parameter",
            f"rate of integral {i} per excess of output {j} over its limit",
            None,
            value,
        )
        for i, row in enumerate(own.anti_windup, 1)
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
    proved = json.loads(certificate)
    thrust_map = [[float(value) for value in row] for row in inertia(TABLE_1)]
    own = _integrals(proved, thrust_map)
    reference = [f"reference.{axis}" for axis in ("x", "y", "z", "psi")]
    table += [
        Variable(name, "input", f"set point of eta.{name.removeprefix('reference.')}", unit)
        for name, unit in zip(reference, _VEHICLE.STATE_UNITS, strict=False)
    ]
    table += [
        Variable(name, "output", f"commanded {name}, held between samples", unit, discrete=True)
        for name, unit in _FORCE
    ]
    table += _integral_variables(own)
    table += _gain(proved["K"], own.columns)
    table += [
        Variable(
            f"thrust_map[{i},{j}]",
            "parameter",
            f"force or moment {i} per commanded acceleration {j} (mass matrix of Eq. (3))",
            None,
            value,
        )
        for i, row in enumerate(thrust_map, 1)
        for j, value in enumerate(row, 1)
    ]
    table += [*_anti_windup(own), *_limits(limits), _sample_time(sample_time)]
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
            **_constants_of(own),
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
    own = _integrals(proved, None)
    m, n = len(K), len(own.measured)
    measured = [f"x[{j}]" for j in own.measured]
    outputs = [f"u[{i}]" for i in range(1, m + 1)]
    table = [Variable(x, "input", f"measured state {x}") for x in measured]
    table += [
        Variable(u, "output", f"command {u}, held between samples", discrete=True) for u in outputs
    ]
    table += _integral_variables(own)
    table += _gain(K, own.columns)
    table += _anti_windup(own) if limits else []
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
            **_constants_of(own),
        },
        certificate=certificate,
        notes=_feedback_notes(m, n, with_limits=bool(limits), integrals=bool(own.outputs)),
        scenario=loop_scenario(
            plant,
            controller or f"{name}.fmu",
            feedback_delay=max((d["d"] for d in delays if d["feedback"]), default=0.0),
            step=_STEP,
            end=stop,
        ),
    )


def watched_spec(
    spec: ComponentSpec, *, age: float, envelope: Mapping[str, float] | None = None
) -> ComponentSpec:
    """Add to a controller the outputs that report the use of its assumptions.

    Parameters
    ----------
    age : greatest age of the measured state [s]; 0: not watched.
    envelope : bounds of measured values by name, where the proof has them.
    """
    bounds = dict(envelope or {})
    measured = {v.name: v.unit for v in spec.variables if v.name in spec.constants["measured"]}
    unknown = [*({*bounds} - {*measured}), *(x for x, bound in bounds.items() if not bound > 0)]
    if unknown:
        raise InputError(
            "the envelope does not fit what is measured",
            expected=f"bounds > 0 of {', '.join(measured)}",
            got=", ".join(f"{name}: {bounds[name]:g}" for name in unknown),
        )
    table = [
        Variable(
            *("stamp.state", "input", "time at which the state in use was measured", "s", -1.0),
            discrete=True,
        ),
        Variable("message_age.state", "output", "time since then, or since the start", "s"),
        *watched_variables(("age", "envelope", "saturation")),
        Variable(
            *("age.state", "parameter", "greatest age of the state; 0: not watched", "s", age),
            minimum=0.0,
        ),
    ]
    table += [
        Variable(f"envelope.{x}", "parameter", f"largest |{x}|", measured[x], bound, minimum=0.0)
        for x, bound in bounds.items()
    ]
    module = "cosim.components.hinf_controller.watched"
    return replace(
        spec,
        variables=(*spec.variables, *table),
        behaviour=f"{module}:WatchedFeedback",
        sources=(*spec.sources, "cosim.models.assumptions", module),
        constants={**spec.constants, "envelope": [*bounds]},
        notes=spec.notes + _WATCHED_NOTES,
    )


def watched_variables(uses: Sequence[str]) -> list[Variable]:
    """Return the use of assumptions, at present and at most, and whether all are met."""
    table = [
        Variable(f"{word}.{use}", "output", f"use of the {_USES[use]}, {when}: 1 is all of it")
        for word, when in (("present", "at present"), ("assumption", "greatest so far"))
        for use in uses
    ]
    text = "1 until an assumption is used beyond 1, 0 from then on"
    return [*table, Variable("assumption.met", "output", text, None, 1.0, "Integer")]


_USES = {"age": "greatest ages", "envelope": "envelope", "saturation": "limits of the commands"}
_WATCHED_NOTES = """
## The assumptions of the proof

The proof holds while the age of the measured state, the envelope and the limits are used by no
more than 1. `present.age`, `present.envelope` and `present.saturation` are the share at present, of
`age.state`, of `envelope.*` by what is measured, and of the limits by what is commanded before it
is limited; `assumption.*` are their greatest values so far, and `assumption.met` is 1 while none is
beyond 1. The age is the time since `stamp.state`, which travels with the measurement.
"""


def _constants_of(own: _Integrals) -> dict[str, Any]:
    """Return what the behaviour must know of integrals; nothing for a static feedback of x."""
    if not own.outputs and own.columns == list(range(1, len(own.columns) + 1)):
        return {}
    return {"columns": own.columns, "integrals": own.outputs, "integrated": own.S}


def _feedback_notes(m: int, n: int, *, with_limits: bool, integrals: bool) -> str:
    bounds = ", each limited to ± `limit.u[i]`" if with_limits else ", without limits"
    return (
        "\n## This controller\n\nFor a system in the form of Eq. (7): "
        f"{n} measured state{'s' * (n != 1)} `x[j]`, {m} command{'s' * (m != 1)} `u[i]`{bounds}.\n"
        + ("The outputs `xi[l]` are integrals of them.\n" if integrals else "")
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
