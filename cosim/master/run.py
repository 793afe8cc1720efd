"""What came of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master.component_instance import ComponentInstance
from cosim.master.engine import EngineChoice
from cosim.network import PacketSchedule

RunStatus = Literal["finished", "stopped", "diverged", "failed"]


@dataclass(frozen=True)
class Run:
    """What happened.

    Attributes
    ----------
    status : "finished" at the end; "stopped" when somebody, or a component, asked for it;
        "diverged" when an output left the allowed range or the numbers; "failed" when a
        component refused for another reason.
    reason : in words, None when finished.
    points_ns : the points reached [ns], int64 (k,).
    instances : the rows, of which the first k are valid.
    engine : which engine carried the run out, and why that one.
    schedules : by packet link, its traffic up to the last point.
    """

    status: RunStatus
    reason: str | None
    points_ns: NDArray[np.int64]
    instances: tuple[ComponentInstance, ...]
    engine: EngineChoice
    schedules: Mapping[str, PacketSchedule]

    def signal(self, component: str, variable: str) -> NDArray[np.float64]:
        """Values of an output or a connected input at the points reached, shape (k,).

        Raises
        ------
        InputError : no such component, or the variable was not part of the run.
        """
        names = {s.name: s for s in self.instances}
        instance = names.get(component)
        if instance is None:
            raise InputError.unknown("component", component, names)
        count = self.points_ns.size
        number, _ = instance.place(variable)
        instance.inputs(count)
        values = instance.rows[:count, number]
        return values if instance.own_points.always else values[instance.own_points.last[:count]]
