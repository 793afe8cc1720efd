"""[links.NAME]: what a scenario says about a link, and the link of the network that it is."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.master import Link
from cosim.network import GilbertElliott, Jitter, PacketLink, TransportLink
from cosim.scenario.fields import (
    BitRate,
    Bits,
    Delay,
    Duration,
    NotNegative,
    Number,
    Part,
    Probability,
)


class JitterPart(Part):
    """Extra delay of each message, never negative."""

    kind: Literal["uniform", "exponential", "normal"]
    width: Delay = 0.0
    mean: Delay = 0.0
    sigma: Delay = 0.0
    max: Duration | None = None


class BurstPart(Part):
    """Gilbert-Elliott loss."""

    p_enter: Probability
    p_exit: Probability
    loss_good: Probability = 0.0
    loss_bad: Probability = 1.0


class PacketPart(Part):
    """[links.NAME] with kind = "packet"."""

    kind: Literal["packet"]
    sample_time: Duration
    offset: Delay = 0.0
    delay: Delay = 0.0
    jitter: JitterPart | None = None
    loss: Probability | BurstPart = 0.0
    order: Literal["newest-wins", "fifo", "as-arrived"] = "newest-wins"
    on_loss: Literal["hold", "zero"] | Number = "hold"
    quantization: NotNegative = 0.0
    data_rate: BitRate = 0
    frame_size: Bits = 0
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None


class TransportPart(Part):
    """[links.NAME] with kind = "transport"."""

    kind: Literal["transport"]
    delay: Delay


LinkPart = Annotated[PacketPart | TransportPart, Field(discriminator="kind")]


def nanoseconds(seconds: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(seconds * 1e9)


def link_of(name: str, part: LinkPart, seed: int) -> Link:
    """The link that a part of a scenario describes; `seed` of the run.

    Raises
    ------
    InputError : parameters that do not fit together.
    """
    if not isinstance(part, PacketPart):
        return TransportLink(name, nanoseconds(part.delay))
    return PacketLink(
        name=name,
        sample_time_ns=nanoseconds(part.sample_time),
        offset_ns=nanoseconds(part.offset),
        delay_ns=nanoseconds(part.delay),
        jitter=_jitter(part.jitter),
        loss=_loss(part.loss),
        order=part.order,
        on_loss=part.on_loss,
        quantization=part.quantization,
        data_rate=part.data_rate,
        frame_size=part.frame_size,
        seed=seed if part.seed is None else part.seed,
    )


def _jitter(part: JitterPart | None) -> Jitter:
    if part is None:
        return Jitter()
    return Jitter(
        kind=part.kind,
        width_ns=nanoseconds(part.width),
        mean_ns=nanoseconds(part.mean),
        sigma_ns=nanoseconds(part.sigma),
        max_ns=None if part.max is None else nanoseconds(part.max),
    )


def _loss(part: float | BurstPart) -> float | GilbertElliott:
    if isinstance(part, BurstPart):
        return GilbertElliott(part.p_enter, part.p_exit, part.loss_good, part.loss_bad)
    return part
