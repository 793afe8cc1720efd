"""How the state of a run moved: its error against the set-points, and whether it grew undriven."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.models import DelaySystem
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.guarantee.designed_loop import DesignedLoop, set_point_of
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.performance import binding_for


@dataclass(frozen=True)
class Motion:
    """How the state of a run moved.

    Attributes
    ----------
    errors : state, or output of the plant, with a set-point -> its last value less the set-point,
        and the unit; the trim is the set-point of what has no other.
    driven : whether a disturbance acted, or a set-point moved.
    growth : greatest error of the last quarter over that of the first; None without both.
    """

    errors: Mapping[str, tuple[float, str]]
    driven: bool
    growth: float | None


@measure
def measured_motion(
    run: MeasuredRun, loop: DesignedLoop, system: DelaySystem, seen_as: DesignedPlant | None
) -> Fold[Motion | None]:
    """Measure the motion of a run; None of a plant that is not known.

    Parameters
    ----------
    loop : of the design.
    system : that the plant was designed as.
    seen_as : how the plant is seen as that system, where the design knows.
    """
    plant = run.instances[loop.plant]
    ports, binding = plant.component.description.ports, binding_for(plant, system, seen_as)
    if binding is None or not all(name in ports for name in binding.state.names):
        return None
    names, measured = (
        list(binding.state.names),
        run.instances[loop.controller].component.description.ports,
    )
    given = {
        j: name
        for j, state in enumerate(names)
        for name in (f"reference[{j + 1}]", set_point_of(state))
        if name in measured
    }
    disturbances = [x for x in binding.disturbance.names if x in ports]
    outputs = run.reader(loop.plant, [*names, *disturbances])
    references = run.reader(loop.controller, [*given.values()])
    quarter_ns = run.comm_points.end_ns // 4, run.comm_points.end_ns * 3 // 4
    begin = end = 0.0
    driven, error = False, np.zeros((1, len(names)))
    while block := (yield):
        rows, reference = (each.read(block) for each in (outputs, references))
        error = rows[:, : len(names)] - np.array(binding.state.trim)
        error[:, [*given]] -= reference
        driven |= bool((reference[1:] != reference[:-1]).any() or rows[:, len(names) :].any())
        points, size = run.points_ns(block), np.abs(error).max(axis=1)
        begin = max(begin, float(size[points <= quarter_ns[0]].max(initial=0.0)))
        end = max(end, float(size[points >= quarter_ns[1]].max(initial=0.0)))
    units = (ports[name].unit or "" for name in names)
    errors = dict(zip(names, zip(error[-1].tolist(), units, strict=True), strict=True))
    growth = end / begin if begin > 0 and end > 0 else None
    return Motion(errors, driven, growth if growth and np.isfinite(growth) else None)
