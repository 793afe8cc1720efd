"""The delay that a connection has because it is cut: its receiver reads one point later."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Connection, Run, System, receiving_order
from cosim.scenario.measure import Measure, after

Integers = NDArray[np.int64]


class CutMeasure(Measure[dict[Connection, float]]):
    """By connection that is cut because of unknown feedthrough the delay that this adds [s].

    That is the longest step of the run that ends at one of the receiver's points; a sender with a
    step of its own sends less often, and its step counts.
    """

    def __init__(self, system: System) -> None:
        self._cut = receiving_order(system).cut
        self._largest = dict.fromkeys(self._cut, 0)
        self._sent: dict[Connection, Integers] = {}

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find senders and receivers."""
        self._instances = {instance.name: instance for instance in instances}

    def add(self, first: int, last: int) -> None:
        """Take the steps that end at the points."""
        for c in self._cut:
            sender, receiver = (self._instances[end.component] for end in (c.source, c.target))
            sent = receiver.comm_points.points_ns[first:last]
            before = self._sent.get(c)
            if c.link is None:
                own = sender.own_points.last[first:last]
                sent = sent[np.maximum(own - first, 0)]
                if before is not None:
                    sent[own < first] = before[0]
            here = receiver.own_points.own_between(first, last) - first
            sent = after(before, sent)
            late = np.diff(sent)[here if before is not None else here[here > 0] - 1]
            self._largest[c] = max(self._largest[c], int(late.max(initial=0)))
            self._sent[c] = sent[-1:].copy()

    def result(self, run: Run) -> dict[Connection, float]:
        """Return the delays."""
        del run
        return {c: float(late) / 1e9 for c, late in self._largest.items()}
