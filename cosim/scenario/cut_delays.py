"""The delay that a connection has because it is cut: its receiver reads one point later."""

from __future__ import annotations

import numpy as np

from cosim.master import Connection, System, receiving_order
from cosim.scenario.measure import Fold, MeasuredRun, measure


@measure
def cut_delays(run: MeasuredRun, system: System) -> Fold[dict[Connection, float]]:
    """Measure by connection that is cut because of unknown feedthrough the delay of this [s].

    That is the longest step of the run that ends at one of the receiver's points; a sender with a
    step of its own sends less often, and its step counts.
    """
    largest = dict.fromkeys(receiving_order(system).cut, 0)
    while block := (yield):
        first, _, last = block
        for c in largest:
            sent = np.arange(first, last)
            if c.link is None:
                sent = run.instances[c.source.component].own_points.last[sent]
            steps = np.diff(run.comm_points.points_ns[sent])
            own = run.instances[c.target.component].own_points.own_between(first + 1, last)
            largest[c] = max(largest[c], int(steps[own - first - 1].max(initial=0)))
    return {c: float(delay) / 1e9 for c, delay in largest.items()}
