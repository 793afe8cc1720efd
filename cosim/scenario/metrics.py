"""Status and metrics of a run, and the assumptions of its guarantee.

The guarantee applies to a run only if all its assumptions were met; each is always listed by
name, true or false.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from cosim.hinf import Design, WorstCase, check_certificate
from cosim.master import Run, System
from cosim.models import total
from cosim.network import PacketSchedule
from cosim.scenario.age import NONE_IN_USE, measurement_age_ns
from cosim.scenario.coupling import coupling_delays_s, cut_delays_s
from cosim.scenario.gain import Problem
from cosim.scenario.limits import Saturation, saturation
from cosim.scenario.performance import binding_for, measured_gain
from cosim.scenario.plant import is_plant_of, is_vehicle_of
from cosim.scenario.schema import Scenario

_ENVELOPE = {"u": "nu.u", "v": "nu.v", "w": "nu.w", "r": "nu.r", "psi": "eta.psi"}
_POSITION = ("eta.x", "eta.y", "eta.z")


@dataclass(frozen=True)
class RunContext:
    """A run with everything its metrics depend on.

    zero_state_run : None if not made.
    worst_case : of the design; None if the scenario does not apply it.
    altered_by_events : events changed something other than the traffic of links.
    """

    scenario: Scenario
    problem: Problem | None
    design: Design | None
    run: Run
    zero_state_run: Run | None
    schedules: Mapping[str, PacketSchedule]
    worst_case: WorstCase | None = None
    system: System | None = None
    altered_by_events: bool = False


def status_of(context: RunContext) -> str:
    """Return the status: finished, limit_cycle, stopped, diverged or failed."""
    if context.run.status != "finished":
        return context.run.status
    used = _saturation(context)
    return "limit_cycle" if used is not None and used.limit_cycle else "finished"


def metrics_of(context: RunContext) -> dict[str, Any]:
    """Return the metrics of a run, JSON-safe: None for what does not exist."""
    design = context.design
    gamma, norm = (None, None) if design is None else (design.gamma, design.exact_norm)
    used = _saturation(context)
    age = _largest_age_s(context)
    gain = _gain(context)
    return {
        "gain": gain,
        "norm_reached": gain / norm if gain is not None and norm else None,
        "gain_within_gamma": None if gain is None or gamma is None else gain <= gamma,
        "gamma": gamma,
        "exact_norm": norm,
        "abscissa": None if design is None else design.abscissa,
        "worst_case": None if context.worst_case is None else asdict(context.worst_case),
        "position_error_m": _position_error(context),
        "saturated_fraction": None if used is None else used.fraction,
        "largest_command": None if used is None else used.largest,
        "message_age_s": age,
        "designed_age_s": _designed_age_s(context),
        "envelope_use": _envelope_use(context),
        **_coupling(context),
        "assumptions": _assumptions(context, used, age),
    }


def _coupling(context: RunContext) -> dict[str, Any]:
    """Return the largest coupling delay, and that of each connection where they may differ."""
    if context.system is None or context.run.points_ns.size < 2:
        return {"coupling_delay_s": None}
    delays = coupling_delays_s(context.run, context.system)
    own = context.scenario.components.values()
    plain = context.scenario.run.algorithm == "jacobi" and all(p.step is None for p in own)
    routes = (route for instance in context.run.instances for route in instance.routes)
    plain &= all(route.route_key.policy != "previous" for route in routes)
    found: dict[str, Any] = {"coupling_delay_s": max(delays.values(), default=0.0)}
    if not plain:
        found["coupling_delays_s"] = delays
    cut = cut_delays_s(context.run, context.system)
    if cut:
        found["cut_connections"] = [
            {"from": str(c.source), "to": str(c.target), "delay_s": late} for c, late in cut.items()
        ]
    return found


def _assumptions(
    context: RunContext, used: Saturation | None, age: float | None
) -> dict[str, bool]:
    """Return whether each assumption was met, by name; empty without a guarantee."""
    if context.design is None or context.problem is None:
        return {}
    result = {"certificate_verified": _certificate_verified(context.design)}
    designed = _designed_age_s(context)
    if designed is not None:
        substituted = any(s.statistics()["substitutions"] for s in context.schedules.values())
        result["message_age_within_design"] = (
            age is not None and age <= designed * (1 + 1e-12) and not substituted
        )
    use = _envelope_use(context)
    if use is not None:
        result["state_inside_envelope"] = all(share <= 1.0 for share in use.values())
    if used is not None:
        zero_state_run = _saturation(context, zero_state_run=True)
        result["limits_not_reached"] = used.fraction == 0.0 and (
            zero_state_run is None or zero_state_run.fraction == 0.0
        )
    if context.scenario.events:
        result["nothing_set_or_overridden"] = not context.altered_by_events
    result["plant_as_designed"] = _plant_as_designed(context)
    return result


_verified: WeakKeyDictionary[Design, bool] = WeakKeyDictionary()


def _certificate_verified(design: Design) -> bool:
    """Whether the proof holds; checked once per design, even in a study of many runs."""
    if design not in _verified:
        _verified[design] = check_certificate(design.certificate).valid
    return _verified[design]


def _saturation(context: RunContext, *, zero_state_run: bool = False) -> Saturation | None:
    run = context.zero_state_run if zero_state_run else context.run
    part = context.scenario.design
    return None if part is None or run is None else saturation(run, part.controller)


def _gain(context: RunContext) -> float | None:
    part, run = context.scenario.design, context.zero_state_run
    if part is None or context.problem is None or run is None or run.status == "failed":
        return None
    binding = binding_for(run, part.plant, context.problem.system)
    if binding is None:
        return None
    return measured_gain(run, part.plant, binding, context.problem.system)


def _position_error(context: RunContext) -> float | None:
    part = context.scenario.design
    if part is None:
        return None
    values = last_outputs(context.run, part.plant)
    if not all(name in values for name in _POSITION):
        return None
    path = context.scenario.reference
    target = {} if path is None else dict(zip(path.axes, path.points[-1][1:], strict=True))
    error = [values[name] - target.get(name.removeprefix("eta."), 0.0) for name in _POSITION]
    size = math.sqrt(total(part * part for part in error))
    return size if np.isfinite(size) else None


def last_outputs(run: Run, component: str) -> dict[str, float]:
    """Return the outputs of a component at the last point reached."""
    for instance in run.instances:
        if instance.name == component and run.points_ns.size:
            row = instance.outputs[instance.own_points.last[run.points_ns.size - 1]]
            return {c.name: float(row[j]) for j, c in enumerate(instance.output_columns)}
    return {}


def final_values(run: Run) -> dict[str, float | None]:
    """Return `component.variable` -> value at the last point reached; None if not finite."""
    return {
        f"{instance.name}.{name}": value if np.isfinite(value) else None
        for instance in run.instances
        for name, value in last_outputs(run, instance.name).items()
    }


def _largest_age_s(context: RunContext) -> float | None:
    part = context.scenario.design
    if part is None:
        return None
    algorithm = context.scenario.run.algorithm
    ages = measurement_age_ns(context.run, part.plant, part.controller, algorithm)
    used = ages[ages != NONE_IN_USE]
    return float(used.max()) / 1e9 if used.size else None


def _designed_age_s(context: RunContext) -> float | None:
    """Return the largest measurement age the design allows; 0 for immediate feedback."""
    return None if context.problem is None else context.problem.system.feedback_delay


def _envelope_use(context: RunContext) -> dict[str, float] | None:
    """Return the largest |value| / bound per axis, over the run and its zero-state run."""
    part = context.scenario.design
    if context.problem is None or context.problem.vehicle is None or part is None:
        return None
    envelope = context.problem.vehicle.envelope
    runs = [run for run in (context.run, context.zero_state_run) if run is not None]
    use = {}
    for axis, name in _ENVELOPE.items():
        largest = max(float(np.abs(run.signal(part.plant, name)).max()) for run in runs)
        use[axis] = largest / getattr(envelope, axis) if np.isfinite(largest) else float("1e300")
    return use


def _plant_as_designed(context: RunContext) -> bool:
    """Whether every parameter of the plant is that of the design."""
    problem, part = context.problem, context.scenario.design
    instance = next((s for s in context.run.instances if part and s.name == part.plant), None)
    if problem is None or instance is None:
        return False
    component = instance.component
    parameters = {
        name: component.parameters.get(name, port.start)
        for name, port in component.description.ports.items()
    }
    if problem.vehicle is not None:
        return is_vehicle_of(problem.vehicle, parameters)
    return is_plant_of(problem.system, parameters)
