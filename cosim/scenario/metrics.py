"""Status and metrics of a run, and the assumptions of its guarantee.

They are made of measures that watch the run, and its zero-state run. The guarantee applies to a
run only if all its assumptions were met; each is always listed by name, true or false.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np

from cosim import hinf
from cosim.models import total
from cosim.scenario.age_claim import age_figures, feedback_of, measurement_age_figures
from cosim.scenario.gain import observes
from cosim.scenario.guarantee.guarantee_metrics import guarantee_metrics
from cosim.scenario.matching import endpoint
from cosim.scenario.outage_measure import outage_figures
from cosim.scenario.run_context import RunContext
from cosim.scenario.run_measures import OF_COUPLING, OF_GUARANTEE, RunFigures
from cosim.scenario.schema import PathPart, ScenarioPart
from cosim.scenario.wanted import ALL_FIGURES, Wanted

_POSITION = ("eta.x", "eta.y", "eta.z")


def status_of(context: RunContext) -> str:
    """Return the status: finished, limit_cycle, stopped, diverged or failed."""
    if context.run.status != "finished":
        return context.run.status
    used = context.figures.saturation
    return "limit_cycle" if used is not None and used.limit_cycle else "finished"


def metrics_of(context: RunContext, wanted: Wanted = ALL_FIGURES) -> dict[str, Any]:
    """Return the metrics of a run, JSON-safe: None for what does not exist."""
    found = {
        name: metric(context) for name, metric in _METRICS.items() if wanted.has(f"metrics.{name}")
    }
    if wanted.has(*OF_COUPLING):
        found |= _coupling(context)
    if context.system.modes and wanted.has("metrics.modes"):
        found["modes"] = _modes(context)
    if observes(context.design) and wanted.has("metrics.measurement_ages"):
        found["measurement_ages"] = measurement_age_figures(
            context.design, context.figures.stamped_ages or {}, context.figures.command_age_ns
        )
    proved = _outages_proved(context)
    if proved is not None and wanted.has("metrics.outages"):
        at_rest = None if context.zero_state is None else context.zero_state.outages
        found["outages"] = outage_figures(proved, context.figures.outages, at_rest)
    if wanted.has(*OF_GUARANTEE):
        found |= guarantee_metrics(context)
    return found


def _modes(context: RunContext) -> dict[str, Any]:
    """Return by mode machine the state at the end, how often it changed, and the time in each."""
    run, found = context.run, {}
    for machine, (states, _) in context.system.modes.items():
        times, numbers = run.instances[0].comm_points.event_values.changes(machine)
        times, numbers = times[times <= run.end_ns], numbers[times <= run.end_ns]
        spent = np.diff(times, append=run.end_ns) / 1e9
        found[machine] = {
            "state": states[int(numbers[-1])] if numbers.size else None,
            "changes": max(int(times.size) - 1, 0),
            "time_s": {s: float(total(spent[numbers == k])) for k, s in enumerate(states)},
        }
    return found


def _outages_proved(context: RunContext) -> hinf.certificate.Outages | None:
    """Return what the design proves across outages."""
    if context.design is None or observes(context.design):
        return None
    return context.design.guarantees.outages


def _of_design(name: str) -> Callable[[RunContext], Any]:
    return lambda c: None if c.design is None else getattr(c.design, name)


def _norm_reached(context: RunContext) -> float | None:
    norm = None if context.design is None else context.design.exact_norm
    return context.gain / norm if context.gain is not None and norm else None


def _gain_within_gamma(context: RunContext) -> bool | None:
    gamma = None if context.design is None else context.design.gamma
    return None if context.gain is None or gamma is None else context.gain <= gamma


def _of_commands(name: str) -> Callable[[RunContext], Any]:
    def figure(context: RunContext) -> Any:
        used = context.figures.saturation
        return None if used is None else getattr(used, name)

    return figure


def _feedback_age(context: RunContext) -> dict[str, Any] | None:
    if context.design is None or observes(context.design):
        return None
    feedback = None if context.problem is None else feedback_of(context.problem.system)
    return age_figures(feedback, context.figures.ages, context.known_age)


def _coupling(context: RunContext) -> dict[str, Any]:
    """Return the largest coupling delay, and that of each connection where they may differ."""
    if context.run.count < 2:
        return {"coupling_delay_s": None}
    delays, cut = context.figures.coupling_delays_s, context.figures.cut_delays_s
    own, system = context.scenario.components.values(), context.system
    plain = context.scenario.run.algorithm == "jacobi" and all(p.step is None for p in own)
    signals = (c for c in system.connections if not system.is_state(c.source))
    plain &= not cut and all(c.policy != "previous" for c in signals)
    found: dict[str, Any] = {"coupling_delay_s": max(delays.values(), default=0.0)}
    if not plain:
        found["coupling_delays_s"] = delays
    if cut:
        found["cut_connections"] = [
            {"from": str(c.source), "to": str(c.target), "delay_s": late} for c, late in cut.items()
        ]
    return found


def _position_error(context: RunContext) -> float | None:
    part = context.scenario.design
    if part is None:
        return None
    values = context.figures.last_outputs.get(part.plant, {})
    plant = None if context.problem is None else context.problem.plant
    path = _path_to(part.controller, context.scenario)
    if plant is not None:  # of the positions that are controlled, from the trim
        trim = dict(zip(plant.state.names, plant.state.trim, strict=True))
        controlled = [name for name in _POSITION if name in trim and name in values]
        error = [values[name] - trim[name] for name in controlled]
        if not controlled:
            return None
    elif not all(name in values for name in _POSITION):
        return None
    else:
        target = {} if path is None else dict(zip(path.axes, path.points[-1][1:], strict=True))
        error = [values[name] - target.get(name.removeprefix("eta."), 0.0) for name in _POSITION]
    size = math.sqrt(total(part * part for part in error))
    return size if np.isfinite(size) else None


def _path_to(component: str, scenario: ScenarioPart) -> PathPart | None:
    """Return the path that a component follows; where there is one path only, that one."""
    paths = [path for _, path in scenario.paths()]
    mine = [path for path in paths if endpoint(path.target).component == component]
    return next(iter(mine), paths[0] if len(paths) == 1 else None)


def final_values(figures: RunFigures) -> dict[str, float | None]:
    """Return `component.variable` -> value at the last point reached; None if not finite."""
    return {
        f"{component}.{name}": value if np.isfinite(value) else None
        for component, values in figures.last_outputs.items()
        for name, value in values.items()
    }


def _designed_age_s(context: RunContext) -> float | None:
    """Return the largest measurement age the design allows; 0 for immediate feedback."""
    if context.problem is None or observes(context.design):
        return None
    return context.problem.system.feedback_delay


_METRICS: Mapping[str, Callable[[RunContext], Any]] = MappingProxyType(
    {
        "gain": lambda c: c.gain,
        "norm_reached": _norm_reached,
        "gain_within_gamma": _gain_within_gamma,
        "gamma": _of_design("gamma"),
        "exact_norm": _of_design("exact_norm"),
        "abscissa": _of_design("abscissa"),
        "worst_case": lambda c: None if c.worst_case is None else asdict(c.worst_case),
        "position_error_m": _position_error,
        "saturated_fraction": _of_commands("fraction"),
        "largest_command": _of_commands("largest"),
        "message_age_s": lambda c: c.age_s,
        "designed_age_s": _designed_age_s,
        "feedback_age": _feedback_age,
        "envelope_use": lambda c: c.envelope_use,
    }
)
"""By name how each metric is computed, but for those of `_coupling` and the guarantee's."""
