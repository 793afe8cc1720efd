"""Bursts of loss: messages of a link that do not arrive, several in a row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.master import System
from cosim.network import DELIVERED, NOT_RECEIVED, PacketLink
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.run_events import EventCollector
from cosim.trace.outcome import BURST, RunEvent


@measure
def loss_bursts(run: MeasuredRun, system: System, collector: EventCollector) -> Fold[None]:
    """Make an event of each burst: it begins where the third message is missed."""
    links = (link.name for link in system.links.values() if isinstance(link, PacketLink))
    bursts = {name: Bursts(name, collector) for name in links}
    taken = dict.fromkeys(bursts, 0)  # messages that were looked at
    while block := (yield):
        until_ns = int(run.points_ns(block)[-1])
        for name, each in bursts.items():
            messages = run.comm_points.arrivals(name, taken[name])
            count = int(np.searchsorted(messages.arrival_ns, until_ns, side="right"))
            taken[name] += count
            missed = np.isin(messages.status[:count], NOT_RECEIVED)
            relevant = missed | (messages.status[:count] == DELIVERED)
            each.add(messages.arrival_ns[:count][relevant], missed[relevant])
    for each in bursts.values():
        each.close(run.end.end_ns)


class Bursts:
    """The bursts of one link."""

    def __init__(self, link: str, collector: EventCollector) -> None:
        self._link = link
        self._collector = collector
        self._missed = 0
        self._since_ns = 0

    def add(self, times_ns: NDArray[np.int64], missed: NDArray[np.bool_]) -> None:
        """Take the next messages, in order of time [ns]: whether each was missed."""
        received = np.flatnonzero(~missed)
        before = np.concatenate(([-1 - self._missed], received))  # the last that was received
        after = np.append(received, missed.size)
        for k in np.flatnonzero(after - before > BURST).tolist():
            begins, ends = int(before[k]) + BURST, int(after[k])
            if begins >= 0:
                self._begin(int(times_ns[begins]))
            if ends < missed.size:
                self._end(int(times_ns[ends]), ends - int(before[k]) - 1)
        self._missed = missed.size - 1 - int(before[-1])

    def close(self, end_ns: int) -> None:
        """Count a burst that lasts at the end of the run."""
        if self._missed >= BURST:
            self._end(end_ns, self._missed, line=False)
            self._missed = 0

    def _begin(self, time_ns: int) -> None:
        self._since_ns = time_ns
        words = f"{BURST} messages in a row did not arrive"
        self._collector.begun(RunEvent(time_ns, "warning", "loss", self._link, words))

    def _end(self, time_ns: int, count: int, *, line: bool = True) -> None:
        words = f"messages arrive again, after {count} that did not"
        over = RunEvent(time_ns, "info", "loss", self._link, words)
        self._collector.ended(over, time_ns - self._since_ns, line=line)
