"""Bursts of loss: messages of a link that do not arrive, several in a row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
        self._bursts = [_Bursts(name, collector) for name in links]

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
            relevant = np.flatnonzero(missed | (found.status[:count] == DELIVERED))
            each.add(found.arrival_ns[relevant].tolist(), missed[relevant].tolist())

    def result(self, run: Run) -> None:
        """Count the bursts that last at the end of the run."""
        for each in self._bursts:
            each.close(run.end_ns)


class _Bursts:
    """The bursts of one link; `taken` : number of its messages that were looked at."""

    def __init__(self, link: str, collector: EventCollector) -> None:
        self.link, self.taken = link, 0
        self._collector = collector
        self._missed = 0
        self._since = 0

    def add(self, times_ns: Sequence[int], missed: Sequence[bool]) -> None:
        for time_ns, gone in zip(times_ns, missed, strict=True):
            if gone:
                self._missed += 1
                if self._missed == FEWEST:
                    self._since = time_ns
                    words = f"{FEWEST} messages in a row did not arrive"
                    self._collector.begun(RunEvent(time_ns, "warning", "loss", self.link, words))
            else:
                if self._missed >= FEWEST:
                    words = f"messages arrive again, after {self._missed} that did not"
                    over = RunEvent(time_ns, "info", "loss", self.link, words)
                    self._collector.ended(over, time_ns - self._since)
                self._missed = 0

    def close(self, end_ns: int) -> None:
        if self._missed >= FEWEST:
            over = RunEvent(end_ns, "info", "loss", self.link, "")
            self._collector.ended(over, end_ns - self._since, line=False)
            self._missed = 0
