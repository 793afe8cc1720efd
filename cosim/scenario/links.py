"""[links.NAME]: the links of a scenario."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from cosim.scenario.fields import (
    BitRate,
    Bits,
    Delay,
    Duration,
    Length,
    NotNegative,
    Number,
    Part,
    Probability,
    Reference,
    Seconds,
    Speed,
    Text,
)

SPEED_OF_SOUND = 1500.0
"""Speed of sound in sea water [m/s], to 4 % anywhere."""


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


class ProfilePart(Part):
    """A recorded delay: { times = [...], delays = [...] }."""

    times: Annotated[list[Seconds], Field(min_length=1)]
    delays: Annotated[list[Delay], Field(min_length=1)]
    interpolation: Literal["previous", "linear"] = "previous"

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if len(self.times) != len(self.delays):
            raise ValueError(
                f"one delay for each time; got {len(self.times)} times and "
                f"{len(self.delays)} delays"
            )
        return self


class ProfileFilePart(Part):
    """A recorded delay from a CSV file with columns `time` and `delay` in seconds."""

    file: Text
    time: Text = "time"
    delay: Text = "delay"
    interpolation: Literal["previous", "linear"] = "previous"


class SignalDelayPart(Part):
    """A delay that follows a signal: offset + scale * signal, `scale` in seconds per unit."""

    signal: Reference
    scale: Number
    offset: Delay = 0.0


class RangeDelayPart(Part):
    """Delay of sound: offset + distance / speed, from `from` to the position signals `range`."""

    range: Annotated[list[Reference], Field(min_length=1, max_length=3)]
    place: Annotated[list[Length], Field(alias="from", min_length=1, max_length=3)]
    speed: Speed = SPEED_OF_SOUND
    offset: Delay = 0.0

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if len(self.range) != len(self.place):
            raise ValueError(
                f"as many signals as coordinates; got {len(self.range)} and {len(self.place)}"
            )
        return self


_DELAYS = {
    "file": "from a file",
    "times": "recorded",
    "delays": "recorded",
    "signal": "of a signal",
    "range": "of a range",
    "from": "of a range",
}


def _kind_of_delay(value: Any) -> str | None:
    if not isinstance(value, dict | Part):
        return "constant"
    keys = value if isinstance(value, dict) else type(value).model_fields
    return next((kind for key, kind in _DELAYS.items() if key in keys), None)


_NO_DELAY = (
    "a time, or a table with signal and scale, with range and from, with times and delays, "
    "or with file"
)
RecordedDelay = Annotated[
    Annotated[Delay, Tag("constant")]
    | Annotated[ProfilePart, Tag("recorded")]
    | Annotated[ProfileFilePart, Tag("from a file")]
    | Annotated[SignalDelayPart, Tag("of a signal")]
    | Annotated[RangeDelayPart, Tag("of a range")],
    Discriminator(_kind_of_delay, custom_error_type="no_delay", custom_error_message=_NO_DELAY),
]


def _kind_of_loss(value: Any) -> str:
    return "in bursts" if isinstance(value, dict | BurstPart) else "independent"


Loss = Annotated[
    Annotated[Probability, Tag("independent")] | Annotated[BurstPart, Tag("in bursts")],
    Discriminator(_kind_of_loss),
]


class PacketPart(Part):
    """[links.NAME] with kind = "packet"."""

    kind: Literal["packet"]
    sample_time: Duration
    offset: Delay = 0.0
    delay: RecordedDelay = 0.0
    jitter: JitterPart | None = None
    loss: Loss = 0.0
    duplicate: Probability = 0.0
    order: Literal["newest-wins", "fifo", "as-arrived"] = "newest-wins"
    on_loss: Literal["hold", "zero"] | Number = "hold"
    quantization: NotNegative = 0.0
    data_rate: BitRate = 0
    frame_size: Bits = 0
    queue_limit: Annotated[int, Field(ge=0)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**31)] | None = None


class TransportPart(Part):
    """[links.NAME] with kind = "transport"; its delay is constant or recorded."""

    kind: Literal["transport"]
    delay: RecordedDelay


LinkPart = Annotated[PacketPart | TransportPart, Field(discriminator="kind")]
