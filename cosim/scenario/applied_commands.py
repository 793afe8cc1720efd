"""Whether an observer knew what acted on the plant, and when.

A controller with an observer has outputs `applied[j]`: the control that it takes to act, after its
limits and, over a command link, after the play-out. Here they are compared, point by point, with
what the plant received; before the first command that is the trim. A command that was lost, late
for its play-out, or overridden differs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.master import ComponentInstance, Run
from cosim.models import DelaySystem
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.measure import Measure
from cosim.scenario.performance import binding_for, elements, vector_of
from cosim.scenario.signal_reader import SignalReader, reader_of

_CLOSE = 1e-9
"""Relative to the greatest control: maps to commands and back round differently."""


class AppliedCommands(Measure[bool | None]):
    """Whether what the plant received was always what the observer took to act.

    None where the plant's inputs are not known, or the controller does not say.

    Parameters
    ----------
    controller, plant : names of the components.
    system : that the plant was designed as.
    seen_as : how the plant is seen as that system, where the design knows.
    """

    def __init__(
        self,
        controller: str,
        plant: str,
        system: DelaySystem,
        seen_as: DesignedPlant | None = None,
    ) -> None:
        self._controller, self._plant = controller, plant
        self._system, self._seen_as = system, seen_as
        self._greatest = self._apart = 0.0
        self._readers: tuple[SignalReader, SignalReader] | None = None

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the commands at both ends."""
        by_name = {s.name: s for s in instances}
        plant, controller = by_name.get(self._plant), by_name.get(self._controller)
        if plant is None or controller is None:
            return
        binding = binding_for(plant, self._system, self._seen_as)
        names = elements("applied", self._system.B.shape[1])
        ports = controller.component.description.ports
        if binding is None or not all(name in ports for name in names):
            return
        self._control = binding.control
        self._readers = reader_of(plant, binding.control.names), SignalReader(controller, names)
        self.reads_inputs = True

    def add(self, first: int, last: int) -> None:
        """Compare at the points."""
        if self._readers is None:
            return
        received, assumed = (reader.read(first, last) for reader in self._readers)
        acting = vector_of(self._control, received)
        self._greatest = max(self._greatest, float(np.abs(acting).max(initial=0.0)))
        self._apart = max(self._apart, float(np.abs(acting - assumed).max(initial=0.0)))

    def result(self, run: Run) -> bool | None:
        """Return the verdict."""
        del run
        if self._readers is None:
            return None
        return self._apart <= _CLOSE * self._greatest
