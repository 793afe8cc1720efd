"""Bursts of loss: messages of a link that do not arrive, several in a row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Run, System
from cosim.network import DELIVERED, NOT_RECEIVED, PacketLink
from cosim.scenario.measure import Measure
from cosim.scenario.run_events import EventCollector
from cosim.trace import RunEvent

FEWEST = 3
"""Messages in a row that make a burst: one or two may be lost at any time."""


class LossBursts(Measure[None]):
    """Makes an event of each burst: it begins where the third message is missed."""

    def __init__(self, system: System, collector: EventCollector) -> None:
        links = (link.name for link in system.links.values() if isinstance(link, PacketLink))
        self._bursts = [Bursts(name, collector) for name in links]

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Note the points."""
        self._comm_points = instances[0].comm_points if instances else None

    def add(self, first: int, last: int) -> None:
        """Take the messages that arrived or were missed up to the last of the points."""
        del first
        points = self._comm_points
        assert points is not None  # noqa: S101 - rows are of components
        until_ns = int(points.points_ns[last - 1])
        for each in self._bursts:
            found = points.arrivals(each.link, each.taken)
            count = int(np.searchsorted(found.arrival_ns, until_ns, side="right"))
            each.taken += count
            missed = np.isin(found.status[:count], NOT_RECEIVED)
            relevant = missed | (found.status[:count] == DELIVERED)
            each.add(found.arrival_ns[:count][relevant], missed[relevant])

    def result(self, run: Run) -> None:
        """Count the bursts that last at the end of the run."""
        for each in self._bursts:
            each.close(run.end_ns)


class Bursts:
    """The bursts of one link.

    Attributes
    ----------
    link : its name.
    taken : number of its messages that were looked at.
    """

    def __init__(self, link: str, collector: EventCollector) -> None:
        self.link, self.taken = link, 0
        self._collector = collector
        self._missed = 0
        self._since_ns = 0

    def add(self, times_ns: NDArray[np.int64], missed: NDArray[np.bool_]) -> None:
        """Take the next messages, in order of time [ns]: whether each was missed."""
        received = np.flatnonzero(~missed)
        before = np.concatenate(([-1 - self._missed], received))  # the last that was received
        after = np.append(received, missed.size)
        for k in np.flatnonzero(after - before > FEWEST).tolist():
            begins, ends = int(before[k]) + FEWEST, int(after[k])
            if begins >= 0:
                self._begin(int(times_ns[begins]))
            if ends < missed.size:
                self._end(int(times_ns[ends]), ends - int(before[k]) - 1)
        self._missed = missed.size - 1 - int(before[-1])

    def close(self, end_ns: int) -> None:
        """Count a burst that lasts at the end of the run."""
        if self._missed >= FEWEST:
            self._end(end_ns, self._missed, line=False)
            self._missed = 0

    def _begin(self, time_ns: int) -> None:
        self._since_ns = time_ns
        words = f"{FEWEST} messages in a row did not arrive"
        self._collector.begun(RunEvent(time_ns, "warning", "loss", self.link, words))

    def _end(self, time_ns: int, count: int, *, line: bool = True) -> None:
        words = f"messages arrive again, after {count} that did not"
        over = RunEvent(time_ns, "info", "loss", self.link, words)
        self._collector.ended(over, time_ns - self._since_ns, line=line)
