"""What is known of the communication points of a run before it, and the links it has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, distinct
from cosim.master.compiled import compiled_delivery
from cosim.master.component_points import own_instants
from cosim.network import Delivery, PacketLink, TransportLink, begin_deliveries

Link = PacketLink | TransportLink
"""A link of either kind."""

Events = Literal["align", "grid"]
Integers = NDArray[np.int64]

_MOST_POINTS = 1_000_000_000
"""More points than this in a run are taken for a mistake in the units."""


@dataclass(frozen=True)
class CommunicationSchedule:
    """The rule of the communication points of a run, and its links.

    Points are the multiples of the step and the end; with events = "align" also the multiples of
    the components' own steps, given instants, and whenever a message is sent or brings a new
    value. `make_schedule` checks the parts.

    Attributes
    ----------
    step_ns, end_ns, events, links, every_ns : as given to `make_schedule`.
    instants_ns : more points, strictly increasing, int64 (m,).
    given_ns : all points, in place of the rule, strictly increasing from 0 to the end [ns], int64
        (n,); None: by the rule.
    start_ns : time of the components at the beginning of the run [ns]. The run itself, its points,
        links and events, counts from 0; what people and components are told is later by this.
    """

    step_ns: int
    end_ns: int
    events: Events = "align"
    links: Mapping[str, Link] = field(default_factory=dict)
    every_ns: tuple[int, ...] = ()
    instants_ns: Integers = field(default_factory=lambda: np.zeros(0, np.int64))
    given_ns: Integers | None = None
    start_ns: int = 0

    def at_s(self, time_ns: int) -> float:
        """Return an instant of the run by the clock of the components [s]."""
        return (int(time_ns) + self.start_ns) / 1e9

    @classmethod
    def of_points(cls, points_ns: Integers) -> CommunicationSchedule:
        """Return the schedule of given points, strictly increasing from 0 [ns], int64 (n,)."""
        step = int(np.diff(points_ns).min(initial=max(int(points_ns[-1]), 1)))
        return cls(step, int(points_ns[-1]), given_ns=points_ns)

    @cached_property
    def live(self) -> tuple[str, ...]:
        """What is resolved during the run: links by their names, media as medium.NAME."""
        live = (link for link in self._packets.values() if link.is_live)
        return tuple(dict.fromkeys(link.resolved_with for link in live))

    @property
    def grows(self) -> bool:
        """Whether points become known only during the run: they follow a signal of it."""
        return bool(self.live) and self.events == "align"

    @property
    def _packets(self) -> Mapping[str, PacketLink]:
        return {n: link for n, link in self.links.items() if isinstance(link, PacketLink)}

    def begin(self) -> dict[str, Delivery]:
        """Return the deliveries of the packet links at the beginning of a run.

        Raises
        ------
        InputError : far too many messages, a recorded delay that does not last as long as the run.
        """
        step = self.step_ns if self.events == "grid" else None
        compiled = compiled_delivery() if self._packets else None
        return begin_deliveries(self._packets.values(), self.end_ns, step, compiled)

    def known(self, after_ns: int, until_ns: int) -> Integers:
        """Return the points in (after, until] [ns] that depend on no link, int64 (n,)."""
        if self.given_ns is not None:
            return between(self.given_ns, after_ns, until_ns)
        found = own_instants(self.step_ns, after_ns, until_ns, self.end_ns)
        if self.events == "grid":
            return found
        more = [own_instants(e, after_ns, until_ns, self.end_ns) for e in self.every_ns]
        more.append(between(self.instants_ns, after_ns, until_ns))
        return distinct(np.concatenate([found, *more])) if any(m.size for m in more) else found

    def is_even(self, points_ns: Integers) -> bool:
        """Whether these neighbours are a step apart; all multiples of it are points, by rule."""
        span = int(points_ns[-1] - points_ns[0])
        return self.given_ns is None and span == (points_ns.size - 1) * self.step_ns

    @property
    def most(self) -> int:
        """A number that the points do not exceed."""
        if self.given_ns is not None:
            return int(self.given_ns.size)
        count = -(-self.end_ns // self.step_ns) + 1
        if self.events == "grid":
            return count
        count += sum(self.end_ns // every + 2 for every in self.every_ns) + self.instants_ns.size
        # each message is sent, and each message and each copy of one arrives once at most
        return count + sum(
            3 * (self.end_ns // link.sample_time_ns + 1) for link in self._packets.values()
        )

    @cached_property
    def points_ns(self) -> Integers:
        """All points that are known before the run [ns], int64 (n,), for a run that is not long."""
        found = [self.known(-1, self.end_ns)]
        for link in self.begin().values() if self.events == "align" else ():
            if not link.is_live:
                link.advance(self.end_ns)
            found.append(link.sendings(-1, self.end_ns))
            found += [] if link.is_live else [link.changes(-1, self.end_ns)[0]]
        return distinct(np.concatenate(found))


def between(instants_ns: Integers, after_ns: int, until_ns: int) -> Integers:
    """Return those of increasing instants that lie in (after, until] [ns]."""
    first, last = np.searchsorted(instants_ns, [after_ns, until_ns], side="right")
    return instants_ns[first:last]


def make_schedule(
    links: Mapping[str, Link],
    step_ns: int,
    end_ns: int,
    events: Events,
    every_ns: Iterable[int] = (),
    instants_ns: Iterable[int] = (),
    start_ns: int = 0,
) -> CommunicationSchedule:
    """Make the schedule of a run from 0 to `end_ns`; `start_ns` as in `CommunicationSchedule`.

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
            hint=f"a smaller step, such as {end_ns / 1e11:g} s, or a later end",
        )
    if end_ns // step_ns > _MOST_POINTS:
        raise InputError(
            "too many communication points",
            where="run",
            expected=f"at most {_MOST_POINTS}",
            got=f"{end_ns // step_ns}: one each {step_ns / 1e9:g} s up to {end_ns / 1e9:g} s",
        )
    for every in every_ns:
        if not 1 <= every <= end_ns or (events == "grid" and every % step_ns):
            raise InputError(
                "a component's own step does not fit the run",
                where="run",
                expected="0 < step <= end"
                + (", a multiple of the communication step" if events == "grid" else ""),
                got=f"{every / 1e9:g} s, step {step_ns / 1e9:g} s, end {end_ns / 1e9:g} s",
            )
    instants = distinct(np.array([*instants_ns], np.int64))
    own = tuple(every_ns)
    made = CommunicationSchedule(
        step_ns, end_ns, events, dict(links), own, instants, start_ns=start_ns
    )
    made.begin()
    return made
