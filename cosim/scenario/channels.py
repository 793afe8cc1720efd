"""Make the links of the network from those of a scenario and its events at fixed times.

Such events become part of the link: a change of delay makes a recorded delay, a change of loss
a window with that loss; an outage loses what is sent meanwhile (messages under way arrive). A
transport link has no messages: in an outage its receiver keeps its value, so the delay grows.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cosim.core import InputError
from cosim.master import DelaySource, Link
from cosim.network import (
    IN_FLIGHT_NS,
    DelayProfile,
    DelaySignal,
    GilbertElliott,
    Hop,
    Jitter,
    LossChain,
    LossWindow,
    Medium,
    PacketLink,
    Recording,
    TransportLink,
)
from cosim.scenario.link_keys import nanoseconds, of_part
from cosim.scenario.links import (
    BurstPart,
    ChainPart,
    LinkPart,
    PacketPart,
    ProfileFilePart,
    ProfilePart,
    RangeDelayPart,
    RecordingFilePart,
    RecordingPart,
    SignalDelayPart,
)
from cosim.scenario.matching import endpoint


class Change(NamedTuple):
    """A change of a link in [from_ns, until_ns): of its delay, of its loss, or an outage."""

    from_ns: int
    until_ns: int
    delay_ns: int | None = None
    loss: float | None = None

    @property
    def outage(self) -> bool:
        """Whether the link delivers nothing."""
        return self.delay_ns is None and self.loss is None


def link_of(
    name: str,
    part: LinkPart,
    seed: int,
    changes: Sequence[Change] = (),
    media: Mapping[str, Medium] | None = None,
    *,
    adjustable: bool = False,
    start_ns: int = 0,
) -> Link:
    """Make the link that [links.NAME] describes; `seed` is that of the run.

    media : by name; None: it is wanted alone, without the others that share its medium.
    adjustable : conditions of the scenario change its delay or loss.
    start_ns : time at the beginning of the run [ns]; that of a recorded delay is as late.

    Raises
    ------
    InputError : inconsistent parameters, or a change of a delay that is not constant; its place
        is a key of [links.NAME].
    """
    try:
        return _link_of(name, part, seed, changes, media, adjustable=adjustable, start_ns=start_ns)
    except InputError as error:
        place = (error.where or "").removeprefix(f"link {name!r}: ")
        first = re.match(r"[\w.]*", place)
        path = first[0].removesuffix("_ns").split(".") if first else [""]
        if path[0] not in {f.alias or key for key, f in type(part).model_fields.items()}:
            raise
        rest = f": {place}" if ":" in place else ""
        error.where = f"links.{name}.{'.'.join(path)}{rest}"
        error.args = (error.text(),)
        raise


def _link_of(
    name: str,
    part: LinkPart,
    seed: int,
    changes: Sequence[Change],
    media: Mapping[str, Medium] | None,
    *,
    adjustable: bool,
    start_ns: int,
) -> Link:
    constant, varying = _delay(part, start_ns)
    if not isinstance(part, PacketPart):
        if isinstance(varying, DelaySignal):
            raise InputError(
                "a transport link's delay cannot follow a signal",
                where="delay",
                expected='a constant or recorded delay, or kind = "packet"',
            )
        profile = _changed(name, constant, varying, changes, outages=True) or varying
        return TransportLink(name, 0 if profile else constant, profile)
    packet = [change for change in changes if change.delay_ns is not None]
    changed = _changed(name, constant, varying, packet, outages=False) or varying
    return of_part(
        PacketLink,
        part,
        name=name,
        delay_ns=0 if changed is not None else constant,
        delay=changed,
        jitter=Jitter() if part.jitter is None else of_part(Jitter, part.jitter),
        loss=_loss(part.loss),
        seed=seed if part.seed is None else part.seed,
        recording=_recording(part.recording),
        greatest_age_ns=nanoseconds(part.greatest_age),
        on_age=part.on_age,
        hop=_hop(part, media),
        adjustable=adjustable,
        windows=tuple(
            LossWindow(c.from_ns, c.until_ns, 1.0 if c.loss is None else c.loss)
            for c in changes
            if c.delay_ns is None
        ),
    )


def _hop(part: PacketPart, media: Mapping[str, Medium] | None) -> Hop | None:
    """Return the way of a link over its medium, or None."""
    if part.medium is None or part.sender is None or part.receiver is None:
        return None
    if media is None:
        raise InputError(
            "what a link over a medium does depends on the other links over it",
            where="medium",
            expected="a link with a channel of its own",
            got=f"medium {part.medium!r}",
        )
    if part.medium not in media:
        raise InputError.unknown("medium", part.medium, media, where="medium")
    return Hop(media[part.medium], part.sender, part.receiver, part.packet or "")


def _loss(part: float | BurstPart | ChainPart) -> float | GilbertElliott | LossChain:
    """Return the loss that a key says."""
    match part:
        case BurstPart():
            return of_part(GilbertElliott, part)
        case ChainPart():
            return of_part(LossChain, part)
    return part


def _recording(part: RecordingPart | RecordingFilePart | None) -> Recording | None:
    """Return the recording that a link replays, or None."""
    if part is None:
        return None
    if isinstance(part, RecordingFilePart):
        raise InputError("a recording is read with the scenario", where="recording.file")
    lost = np.zeros(len(part.sent), np.bool_)
    if any(k >= lost.size for k in part.lost):
        raise InputError(
            "there is no such message in the recording",
            where="recording.lost",
            expected=f"numbers below {lost.size}",
            got=str(max(part.lost)),
        )
    lost[part.lost] = True
    delays = part.delays
    return of_part(
        Recording,
        part,
        sent_ns=np.array([nanoseconds(t) for t in part.sent], np.int64),
        lost=lost,
        delay_ns=None
        if delays is None
        else np.array([IN_FLIGHT_NS if d == "in flight" else nanoseconds(d) for d in delays]),
    )


def delay_source(part: LinkPart) -> DelaySource | None:
    """Return the signals that determine the delay of a live link; None for any other link."""
    delay = part.delay
    if isinstance(delay, SignalDelayPart):
        return DelaySource((endpoint(delay.signal),))
    if isinstance(delay, RangeDelayPart):
        origin = [endpoint(x) if isinstance(x, str) else x for x in delay.place]
        return DelaySource(tuple(endpoint(s) for s in delay.range), tuple(origin))
    return None


def _delay(part: LinkPart, start_ns: int) -> tuple[int, DelayProfile | DelaySignal | None]:
    """Return the constant delay [ns], and the varying delay or None."""
    match part.delay:
        case SignalDelayPart():
            return 0, of_part(DelaySignal, part.delay)
        case RangeDelayPart():
            return 0, DelaySignal(1.0 / part.delay.speed, nanoseconds(part.delay.offset))
        case ProfilePart():
            recorded = part.delay
            found = DelayProfile.from_seconds(
                recorded.times, recorded.delays, recorded.interpolation
            )
            return 0, replace(found, times_ns=found.times_ns - start_ns) if start_ns else found
        case ProfileFilePart():
            raise InputError("the file of a delay is read with the scenario", where="delay.file")
    return nanoseconds(part.delay), None


def _changed(
    name: str,
    constant: int,
    varying: DelayProfile | DelaySignal | None,
    changes: Sequence[Change],
    *,
    outages: bool,
) -> DelayProfile | None:
    """Return the delay over time; None without changes."""
    if not changes:
        return None
    if varying is not None or any(change.loss is not None for change in changes):
        raise InputError(
            "this link cannot be changed like this",
            where=f"link {name!r}",
            expected="a constant delay to be changed"
            if varying is not None
            else "a packet link: a continuous signal has no messages to lose",
        )
    edges = sorted({0} | {t for c in changes for t in (c.from_ns, c.until_ns)})
    times: list[int] = []
    delays: list[int] = []
    for first, last in zip(edges, [*edges[1:], None], strict=True):
        holding = [c for c in changes if c.from_ns <= first < c.until_ns]
        delay = next((c.delay_ns for c in reversed(holding) if c.delay_ns is not None), constant)
        down = outages and any(c.outage for c in holding)
        since = min((c.from_ns for c in holding if c.outage), default=first)
        times.append(first)
        delays.append(delay + (first - since if down else 0))
        if last is not None and last - first > 1:
            times.append(last - 1)
            delays.append(delay + (last - 1 - since if down else 0))
    return DelayProfile(np.array(times), np.array(delays), "linear")
