"""What may be said about a run: its status, its figures, and which promises were kept.

A guarantee is claimed for a run only where the assumptions it rests on were met; each is
listed by name, true or false, also where nobody asked.
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
from cosim.scenario.coupling import coupling_delays_s
from cosim.scenario.gain import Problem
from cosim.scenario.limits import Saturation, saturation
from cosim.scenario.performance import binding_for, measured_gain
from cosim.scenario.plant import is_plant_of, is_vehicle_of
from cosim.scenario.schema import Scenario

_ENVELOPE = {"u": "nu.u", "v": "nu.v", "w": "nu.w", "r": "nu.r", "psi": "eta.psi"}
_POSITION = ("eta.x", "eta.y", "eta.z")


@dataclass(frozen=True)
class Flight:
    """A run with what it was made from.

    `companion` is the same from rest, None if not made; `push` the worst case of the design,
    None if the scenario does not ask for it; `touched`: events changed more than the traffic
    of links.
    """

    scenario: Scenario
    problem: Problem | None
    design: Design | None
    run: Run
    companion: Run | None
    schedules: Mapping[str, PacketSchedule]
    push: WorstCase | None = None
    system: System | None = None
    touched: bool = False


def status_of(flight: Flight) -> str:
    """finished, limit_cycle, stopped, diverged or failed."""
    if flight.run.ending != "finished":
        return flight.run.ending
    used = _saturation(flight)
    return "limit_cycle" if used is not None and used.limit_cycle else "finished"


def metrics_of(flight: Flight) -> dict[str, Any]:
    """Figures of a flight, JSON-safe: None for what does not exist."""
    design, problem = flight.design, flight.problem
    used = _saturation(flight)
    age = _largest_age_s(flight)
    gain = _gain(flight)
    return {
        "gain": gain,
        "norm_reached": _share(gain, None if design is None else design.exact_norm),
        "gain_within_gamma": None
        if gain is None or design is None or design.gamma is None
        else gain <= design.gamma,
        "gamma": None if design is None else design.gamma,
        "exact_norm": None if design is None else design.exact_norm,
        "abscissa": None if design is None else design.abscissa,
        "worst_case": None if flight.push is None else asdict(flight.push),
        "position_error_m": _position_error(flight),
        "saturated_fraction": None if used is None else used.fraction,
        "largest_command": None if used is None else used.largest,
        "message_age_s": age,
        "designed_age_s": _designed_age_s(problem),
        "envelope_use": _envelope_use(flight),
        **_coupling(flight),
        "assumptions": _assumptions(flight, used, age),
    }


def _coupling(flight: Flight) -> dict[str, Any]:
    """What the exchange adds to the delays of the links: the most, and where they differ, each."""
    if flight.system is None or flight.run.points_ns.size < 2:
        return {"coupling_delay_s": None}
    delays = coupling_delays_s(flight.run, flight.system)
    own = flight.scenario.components.values()
    plain = flight.scenario.run.algorithm == "jacobi" and all(p.step is None for p in own)
    most = {"coupling_delay_s": max(delays.values(), default=0.0)}
    return most if plain else {**most, "coupling_delays_s": delays}


def _share(gain: float | None, norm: float | None) -> float | None:
    return None if gain is None or not norm else gain / norm


def _assumptions(flight: Flight, used: Saturation | None, age: float | None) -> dict[str, bool]:
    """What the guarantee rests on, by name; empty where nothing is guaranteed."""
    if flight.design is None or flight.problem is None:
        return {}
    result = {"certificate_verified": _certificate_verified(flight.design)}
    designed = _designed_age_s(flight.problem)
    if designed is not None:
        substituted = any(s.statistics()["substitutions"] for s in flight.schedules.values())
        result["message_age_within_design"] = (
            age is not None and age <= designed * (1 + 1e-12) and not substituted
        )
    use = _envelope_use(flight)
    if use is not None:
        result["state_inside_envelope"] = all(share <= 1.0 for share in use.values())
    if used is not None:
        companion = _saturation(flight, companion=True)
        result["limits_not_reached"] = used.fraction == 0.0 and (
            companion is None or companion.fraction == 0.0
        )
    if flight.scenario.events:
        result["nothing_set_or_overridden"] = not flight.touched
    result["plant_as_designed"] = _plant_as_designed(flight)
    return result


_verified: WeakKeyDictionary[Design, bool] = WeakKeyDictionary()


def _certificate_verified(design: Design) -> bool:
    """Whether the proof holds; checked once per design, also where thousands of runs fly it."""
    if design not in _verified:
        _verified[design] = check_certificate(design.certificate).valid
    return _verified[design]


def _saturation(flight: Flight, *, companion: bool = False) -> Saturation | None:
    run = flight.companion if companion else flight.run
    part = flight.scenario.design
    return None if part is None or run is None else saturation(run, part.controller)


def _gain(flight: Flight) -> float | None:
    part, run = flight.scenario.design, flight.companion
    if part is None or flight.problem is None or run is None or run.ending == "failed":
        return None
    binding = binding_for(run, part.plant, flight.problem.system)
    if binding is None:
        return None
    return measured_gain(run, part.plant, binding, flight.problem.system)


def _position_error(flight: Flight) -> float | None:
    part = flight.scenario.design
    if part is None:
        return None
    values = last_outputs(flight.run, part.plant)
    if not all(name in values for name in _POSITION):
        return None
    target = _final_reference(flight.scenario)
    error = [values[name] - target.get(name.removeprefix("eta."), 0.0) for name in _POSITION]
    size = math.sqrt(total(part * part for part in error))
    return size if np.isfinite(size) else None


def _final_reference(scenario: Scenario) -> dict[str, float]:
    path = scenario.reference
    if path is None:
        return {}
    return dict(zip(path.axes, path.points[-1][1:], strict=True))


def last_outputs(run: Run, component: str) -> dict[str, float]:
    """Outputs of a component at the last point reached."""
    for station in run.stations:
        if station.name == component and run.points_ns.size:
            row = station.outputs[station.beat.last[run.points_ns.size - 1]]
            return {c.name: float(row[j]) for j, c in enumerate(station.output_columns)}
    return {}


def final_values(run: Run) -> dict[str, float | None]:
    """`component.variable` -> value at the last point reached; None where not finite."""
    return {
        f"{station.name}.{name}": value if np.isfinite(value) else None
        for station in run.stations
        for name, value in last_outputs(run, station.name).items()
    }


def _largest_age_s(flight: Flight) -> float | None:
    part = flight.scenario.design
    if part is None:
        return None
    algorithm = flight.scenario.run.algorithm
    ages = measurement_age_ns(flight.run, part.plant, part.controller, algorithm)
    used = ages[ages != NONE_IN_USE]
    return float(used.max()) / 1e9 if used.size else None


def _designed_age_s(problem: Problem | None) -> float | None:
    """Largest age of the measurements that the design allows for; 0 for immediate feedback."""
    return None if problem is None else problem.system.feedback_delay


def _envelope_use(flight: Flight) -> dict[str, float] | None:
    """Largest excursion over the bound, per axis, of the run and its companion."""
    part = flight.scenario.design
    if flight.problem is None or flight.problem.vehicle is None or part is None:
        return None
    envelope = flight.problem.vehicle.envelope
    runs = [run for run in (flight.run, flight.companion) if run is not None]
    use = {}
    for axis, name in _ENVELOPE.items():
        largest = max(float(np.abs(run.signal(part.plant, name)).max()) for run in runs)
        use[axis] = largest / getattr(envelope, axis) if np.isfinite(largest) else float("1e300")
    return use


def _plant_as_designed(flight: Flight) -> bool:
    """Whether the plant that flew is the one the design is about, parameter by parameter."""
    problem, part = flight.problem, flight.scenario.design
    station = next((s for s in flight.run.stations if part and s.name == part.plant), None)
    if problem is None or station is None:
        return False
    component = station.component
    parameters = {
        name: component.parameters.get(name, port.start)
        for name, port in component.description.ports.items()
    }
    if problem.vehicle is not None:
        return is_vehicle_of(problem.vehicle, parameters)
    return is_plant_of(problem.system, parameters)
