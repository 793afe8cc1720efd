"""The communication points of a run that are known before it, and the schedules of its links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master.component_points import own_instants
from cosim.network import (
    DelaySignal,
    PacketLink,
    PacketSchedule,
    TransportLink,
    align,
    schedule,
    sending_instants,
)

Link = PacketLink | TransportLink
Events = Literal["align", "grid"]

_MOST_POINTS = 20_000_000


@dataclass(frozen=True)
class CommunicationSchedule:
    """The communication points known before a run, and the schedule of every packet link.

    Attributes
    ----------
    points_ns : strictly increasing from 0 to the end [ns], int64 (n,); with live links and
        events = "align", those that are known before the run.
    schedules : by name of the link; all their instants are points, or were moved to one.
    step_ns, events, links, every_ns : as given to `make_schedule`.
    live : the links whose delays follow a signal of the run.
    """

    points_ns: NDArray[np.int64]
    schedules: Mapping[str, PacketSchedule]
    step_ns: int
    live: Mapping[str, PacketLink] = field(default_factory=dict)
    events: Events = "align"
    links: Mapping[str, Link] = field(default_factory=dict)
    every_ns: tuple[int, ...] = ()

    def shortened(self, end_ns: int) -> Mapping[str, PacketSchedule]:
        """Return the schedules of a run that ends earlier: it has the same messages."""
        if end_ns <= 0:
            return {}
        step = min(self.step_ns, end_ns)
        links = {name: link for name, link in self.links.items() if name not in self.live}
        if self.events == "grid":
            known = [schedule(link, end_ns) for link in _packets(links)]
            points = self.points_ns[: int(np.searchsorted(self.points_ns, end_ns)) + 1]
            return {s.link.name: s for s in align(known, points, "grid").schedules}
        return make_schedule(links, step, end_ns, "align").schedules


def make_schedule(
    links: Mapping[str, Link],
    step_ns: int,
    end_ns: int,
    events: Events,
    every_ns: Iterable[int] = (),
    instants_ns: Iterable[int] = (),
) -> CommunicationSchedule:
    """Compute the communication points and the schedules of all links before a run.

    `every_ns` : own steps of components [ns]; under "align" their multiples become points, on
    the grid they must be multiples of the step. `instants_ns` : more instants in [0, end] that
    become points under "align".

    Raises
    ------
    InputError : a step that is not positive or exceeds the end, or far too many points.
    """
    if step_ns < 1 or end_ns < step_ns:
        raise InputError(
            "the communication step does not fit the run",
            where="run",
            expected="0 < step <= end",
            got=f"step {step_ns / 1e9:g} s, end {end_ns / 1e9:g} s",
        )
    if end_ns // step_ns > _MOST_POINTS:
        raise InputError(
            "too many communication points",
            where="run",
            expected=f"at most {_MOST_POINTS}",
            got=f"{end_ns // step_ns}: one each {step_ns / 1e9:g} s up to {end_ns / 1e9:g} s",
        )
    grid = np.append(np.arange(0, end_ns, step_ns, dtype=np.int64), np.int64(end_ns))
    for every in every_ns:
        if not 1 <= every <= end_ns or (events == "grid" and every % step_ns):
            raise InputError(
                "a component's own step does not fit the run",
                where="run",
                expected="0 < step <= end"
                + (", a multiple of the communication step" if events == "grid" else ""),
                got=f"{every / 1e9:g} s, step {step_ns / 1e9:g} s, end {end_ns / 1e9:g} s",
            )
        if events == "align":
            grid = np.union1d(grid, own_instants(every, end_ns))
    if events == "align":
        grid = np.union1d(grid, np.array([*instants_ns], np.int64))
    live = {link.name: link for link in _packets(links) if isinstance(link.delay, DelaySignal)}
    known = [schedule(link, end_ns) for link in _packets(links) if link.name not in live]
    if events == "align":
        sendings = [sending_instants(link, end_ns) for link in live.values()]
        grid = np.unique(np.concatenate([grid, *sendings]))
    if known:
        aligned = align(known, grid, events)
        grid, known = aligned.points_ns, list(aligned.schedules)
    schedules = {s.link.name: s for s in known}
    return CommunicationSchedule(
        grid, schedules, step_ns, live, events, dict(links), tuple(every_ns)
    )


def _packets(links: Mapping[str, Link]) -> list[PacketLink]:
    return [link for link in links.values() if isinstance(link, PacketLink)]
