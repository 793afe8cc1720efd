"""Whether an observer knew what acted on the plant, and when.

A controller with an observer has outputs `applied[j]`: the control that it takes to act, after its
limits and, over a command link, after the play-out. Here they are compared, point by point, with
what the plant received; before the first command that is the trim. A command that was lost, late
for its play-out, or overridden differs.
"""

from __future__ import annotations

import numpy as np

from cosim.models import DelaySystem
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.performance import elements, vectors_of

_CLOSE = 1e-9
"""Relative to the greatest control: maps to commands and back round differently."""


@measure
def commands_known(
    run: MeasuredRun,
    controller: str,
    plant: str,
    system: DelaySystem,
    seen_as: DesignedPlant | None = None,
) -> Fold[bool | None]:
    """Measure whether what the plant received was always what the observer took to act.

    None where the plant's inputs are not known, or the controller does not say.

    Parameters
    ----------
    controller, plant : names of the components.
    system : that the plant was designed as.
    seen_as : how the plant is seen as that system, where the design knows.
    """
    vectors, names = vectors_of(run, plant, system, seen_as), elements("applied", len(system.B.T))
    ports = run.instances[controller].component.description.ports
    if vectors is None or not all(name in ports for name in names):
        return None
    _, control, _ = vectors
    applied = run.reader(controller, names)
    greatest = apart = 0.0
    while block := (yield):
        acting = control.read(block)
        assumed = applied.read(block)
        greatest = max(greatest, float(np.abs(acting).max(initial=0.0)))
        apart = max(apart, float(np.abs(acting - assumed).max(initial=0.0)))
    return apart <= _CLOSE * greatest
