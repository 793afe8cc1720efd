"""A medium that links share: its nodes, how sound travels between them, and who may send when.

The declaration; `cosim.network.medium_traffic` computes what becomes of the messages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from cosim.core import InputError
from cosim.network.checks import MAX_NS, check_duration, check_name, is_finite
from cosim.network.delay_signal import DelaySignal
from cosim.network.keys import ChoiceKey, CountKey, DurationKey, NumberKey, check_keys
from cosim.network.range_loss import RangeLogit, RangeTable

Access = Literal["aloha", "csma", "tdma"]
"""When a node begins to send: at once, when it hears nothing, or in slots of its own."""

SPEED_OF_SOUND = 1500.0
"""Speed of sound in sea water [m/s], to 4 % anywhere."""


def distance(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the distance of two places of as many coordinates [m]."""
    total = 0.0
    for a, b in zip(one, other, strict=True):
        total += (a - b) * (a - b)
    return math.sqrt(total)


@dataclass(frozen=True, slots=True)
class Node:
    """A sender and receiver on a medium.

    Parameters
    ----------
    name : of the node.
    place : one to three coordinates [m]; None: one that follows a signal of the run.
    """

    name: str
    place: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class Medium:
    """A medium on which every node hears every other one, unless it is too far away.

    Parameters
    ----------
    name : of the medium.
    nodes : at least two, with as many coordinates each.
    data_rate : bit/s; a packet takes preamble + frame_size / data_rate (its airtime), rounded up
        to nanoseconds.
    preamble_ns : time that a packet takes beside its bits [ns].
    speed : speed at which packets travel [m/s]; the delay range / speed is rounded to the nearest
        nanosecond, with the range at the instant at which the packet begins to be sent.
    access : "aloha": a node begins to send when it has finished the packet before. "csma": when it
        hears no packet, too; else it looks again after a random time up to `backoff_ns`. "tdma": at
        the beginning of each of its slots.
    slot_ns : packets begin at multiples of it [ns]; 0: at any instant.
    slots : the nodes of the slots of a TDMA frame, in order; the first slot begins at 0.
    backoff_ns : greatest random time before a packet under "aloha", before another look under
        "csma" [ns].
    turnaround_ns : so long a node hears nothing after it sent [ns].
    max_range : greatest range at which a packet is received [m]; None: any.
    interference_range : greatest range at which a packet is heard, and so disturbs others, at least
        `max_range` [m]; None: `max_range`.
    loss : probability of a loss by range, of packets that nothing disturbed; None: none is lost.

    Raises
    ------
    InputError : a parameter out of its range, or some that do not go together.
    """

    name: str
    nodes: tuple[Node, ...]
    data_rate: Annotated[int, CountKey("bits per second of every packet, whole", unit="bit/s")]
    preamble_ns: Annotated[int, DurationKey("time that a packet takes beside its bits")] = 0
    speed: Annotated[float, NumberKey("speed at which packets travel", positive=True)] = (
        SPEED_OF_SOUND
    )
    access: Annotated[Access, ChoiceKey("when a node begins to send", get_args(Access))] = "aloha"
    slot_ns: Annotated[int, DurationKey("packets begin at multiples of it; 0: at any instant")] = 0
    slots: tuple[str, ...] = ()
    backoff_ns: Annotated[
        int, DurationKey("greatest random time before a packet, or before listening again")
    ] = 0
    turnaround_ns: Annotated[int, DurationKey("so long a node hears nothing after it sent")] = 0
    max_range: Annotated[float | None, NumberKey("greatest range of reception", positive=True)] = (
        None
    )
    interference_range: Annotated[
        float | None, NumberKey("greatest range at which a packet disturbs others", positive=True)
    ] = None
    loss: RangeTable | RangeLogit | None = None

    def __post_init__(self) -> None:
        check_name("medium", self.name)
        where = f"medium {self.name!r}: "
        check_keys(where, self)
        self._check_nodes(where)
        self._check_access(where)
        if self.data_rate < 1:
            raise InputError(
                "data_rate out of range",
                where=f"{where}data_rate",
                expected="at least 1 bit/s",
                got=repr(self.data_rate),
            )
        if self.interference_range is not None and self.interference_range < (
            math.inf if self.max_range is None else self.max_range
        ):
            raise InputError(
                "a packet that is received is heard",
                where=f"{where}interference_range",
                expected=f"at least max_range, {self.max_range}",
                got=f"{self.interference_range:g}",
            )

    def _check_nodes(self, where: str) -> None:
        names = [node.name for node in self.nodes]
        if len(names) < 2 or len(set(names)) < len(names):
            raise InputError(
                "a medium needs nodes",
                where=f"{where}nodes",
                expected="at least two, of different names",
                got=", ".join(names) or "none",
            )
        lengths = {len(node.place) for node in self.nodes}
        if len(lengths) > 1 or not lengths <= {1, 2, 3}:
            raise InputError(
                "the places of the nodes do not go together",
                where=f"{where}nodes",
                expected="one to three coordinates, as many for each",
                got=", ".join(f"{node.name}: {len(node.place)}" for node in self.nodes),
            )
        for node in self.nodes:
            if not all(at is None or is_finite(at) for at in node.place):
                raise InputError(
                    "a coordinate is a finite number",
                    where=f"{where}nodes.{node.name}",
                    got=repr(node.place),
                )

    def _check_access(self, where: str) -> None:
        tdma, csma = self.access == "tdma", self.access == "csma"
        wrong: dict[str, tuple[bool, str, Any]] = {
            "slot": (tdma and not self.slot_ns, 'a duration: access = "tdma" has slots', 0),
            "slots": (
                bool(self.slots) != tdma,
                'the nodes of the slots with access = "tdma", else none',
                list(self.slots),
            ),
            "backoff": (
                (csma and not self.backoff_ns) or (tdma and self.backoff_ns > 0),
                'a duration with access = "csma", 0 with "tdma"',
                f"{self.backoff_ns} ns",
            ),
        }
        for key, (is_wrong, expected, got) in wrong.items():
            if is_wrong:
                raise InputError(
                    f"{key} does not go with the access of the medium",
                    where=where + key,
                    expected=expected,
                    got=f'{got}, access = "{self.access}"',
                )
        for name in self.slots:
            self.number(name, f"{where}slots")

    def number(self, name: str, where: str) -> int:
        """Return the number of a node.

        Raises
        ------
        InputError : there is none of this name.
        """
        names = [node.name for node in self.nodes]
        if name not in names:
            raise InputError.unknown("node", name, names, where=where)
        return names.index(name)

    @property
    def moves(self) -> bool:
        """Whether places of nodes follow signals of the run."""
        return any(at is None for node in self.nodes for at in node.place)

    @property
    def hearing_range(self) -> float:
        """Greatest range at which a packet is heard [m]."""
        limits = (self.interference_range, self.max_range)
        return next((limit for limit in limits if limit is not None), math.inf)

    def airtime_ns(self, frame_size: int) -> int:
        """Return the time that it takes to send a packet of so many bits [ns], rounded up."""
        return int(self.preamble_ns) + -(-int(frame_size) * 10**9 // int(self.data_rate))

    def delay_ns(self, range_m: float, *, where: str) -> int:
        """Return the time that a packet travels [ns]; `where` is named in errors.

        Raises
        ------
        InputError : a range that is not finite, or makes a delay out of range.
        """
        if not range_m <= self.speed * MAX_NS / 1e9:
            raise InputError(
                "the way takes too long",
                where=where,
                expected="at most 2**53 ns",
                got=f"{range_m:g} m at {self.speed:g} m/s",
            )
        return DelaySignal(1.0 / self.speed).delay_ns(range_m, where=where)

    def at(self, values: Sequence[float]) -> tuple[tuple[float, ...], ...]:
        """Return the places of the nodes, with these values of what follows signals, in order.

        Raises
        ------
        InputError : a value that is no finite number.
        """
        places = []
        missing = sum(at is None for node in self.nodes for at in node.place)
        if len(values) != missing:
            raise InputError(
                "other coordinates follow signals than there are values",
                where=f"medium {self.name!r}",
                expected=f"{missing} values",
                got=str(len(values)),
            )
        given = iter(values)
        for node in self.nodes:
            place = tuple(float(next(given) if at is None else at) for at in node.place)
            if not all(map(math.isfinite, place)):
                raise InputError(
                    "the place of a node is not finite",
                    where=f"medium {self.name!r}, node {node.name!r}",
                    expected="finite coordinates [m]",
                    got=repr(place),
                )
            places.append(place)
        return tuple(places)


@dataclass(frozen=True, slots=True)
class Hop:
    """The way of a link over a medium: from one node to another.

    Parameters
    ----------
    medium : the medium.
    sender, receiver : names of two of its nodes.
    packet : name of the packets that the link shares with others of its sender: sent once, and
        received or not by each of their receivers; "": it has its own.

    Raises
    ------
    InputError : no such node, one node, or a sender without a slot.
    """

    medium: Medium
    sender: str
    receiver: str
    packet: str = ""

    def __post_init__(self) -> None:
        for key, name in (("from", self.sender), ("to", self.receiver)):
            self.medium.number(name, key)
        if self.sender == self.receiver:
            raise InputError(
                "a link goes from one node to another",
                where="to",
                expected=f"another node than {self.sender!r}",
                got=repr(self.receiver),
            )
        if self.medium.slots and self.sender not in self.medium.slots:
            raise InputError(
                "the sender has no slot",
                where="from",
                expected="one of " + ", ".join(dict.fromkeys(self.medium.slots)),
                got=repr(self.sender),
            )

    def check(self, where: str, frame_size: int) -> None:
        """Check the packets of a link.

        Raises
        ------
        InputError : no size, or one too long for a slot.
        """
        airtime = self.medium.airtime_ns(frame_size)
        check_duration(f"{where}: frame_size / data_rate", airtime)
        longest = self.medium.slot_ns if self.medium.access == "tdma" else None
        if not frame_size or (longest is not None and airtime > longest):
            raise InputError(
                "a packet on a medium has a size"
                if not frame_size
                else "a packet exceeds its slot",
                where=f"{where}: frame_size",
                expected="bits, headers included"
                if longest is None
                else f"bits, headers included, that take at most {longest} ns to send",
                got=f"{frame_size} bit, {airtime} ns",
            )
