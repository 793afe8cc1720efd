"""[links.NAME]: the links of a scenario."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from cosim.core import Number, Text
from cosim.network import (
    SPEED_OF_SOUND,
    DelaySignal,
    GilbertElliott,
    Interpolation,
    Jitter,
    LogFormat,
    LossChain,
    PacketLink,
    Recording,
    TransportLink,
)
from cosim.scenario.fields import (
    LinkTime,
    Name,
    Part,
    Place,
    Probability,
    Reference,
    Seconds,
    Speed,
)
from cosim.scenario.link_keys import part_of

_Jitter: Any = part_of(Jitter, kind=(Literal["uniform", "exponential", "normal"], ...))
_Burst: Any = part_of(GilbertElliott)
_Chain: Any = part_of(
    LossChain, first={"kind": (Annotated[Literal["chain"], Field(description="A chain.")], ...)}
)
_Format: Any = part_of(LogFormat)
_SignalDelay: Any = part_of(
    DelaySignal, first={"signal": (Annotated[Reference, Field(description="The signal.")], ...)}
)


class JitterPart(_Jitter):  # type: ignore[misc]
    """Extra delay of each message, never negative."""


class BurstPart(_Burst):  # type: ignore[misc]
    """Gilbert-Elliott loss."""


class ChainPart(_Chain):  # type: ignore[misc]
    """Loss in a chain of hidden states."""


class LogFormatPart(_Format):  # type: ignore[misc]
    """How a log is written; what is not said is found in the file, or an error."""


class ProfilePart(Part):
    """A recorded delay: { times = [...], delays = [...] }."""

    times: Annotated[list[Seconds], Field(min_length=1)]
    """Instants of sending at which the delay was recorded; they increase."""
    delays: Annotated[list[LinkTime], Field(min_length=1)]
    """Delay at each of them."""
    interpolation: Interpolation = "previous"
    """Between two of them: the delay of the one before ("previous"), or on a line ("linear")."""

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if len(self.times) != len(self.delays):
            raise ValueError(
                f"one delay for each time; got {len(self.times)} times and "
                f"{len(self.delays)} delays"
            )
        return self


class ProfileFilePart(Part):
    """A recorded delay from a CSV file with columns `time` and `delay`."""

    file: Text
    """CSV file, from the folder of the scenario."""
    time: Text = "time"
    """Column of the instants of sending, from the start of the run on."""
    delay: Text = "delay"
    """Column of the delays."""
    format: LogFormatPart | None = None
    """Its delimiter, decimal and unit; without it found in the file, and seconds."""
    interpolation: Interpolation = "previous"
    """Between two rows: the delay of the one before ("previous"), or on a line ("linear")."""


class SignalDelayPart(_SignalDelay):  # type: ignore[misc]
    """A delay that follows a signal: offset + scale * signal, `scale` in seconds per unit."""


class RangeDelayPart(Part):
    """Delay of sound: offset + distance / speed, between the positions `range` and `from`."""

    range: Annotated[list[Reference], Field(min_length=1, max_length=3)]
    """Signals that are the position of one end, which moves, one to three."""
    place: Annotated[Place, Field(alias="from")]
    """Position of the other end, one coordinate per signal: a length, or a signal of what moves."""
    speed: Speed = SPEED_OF_SOUND
    """Speed of the signal; that of sound in sea water without it."""
    offset: LinkTime = 0.0
    """Delay at distance 0."""

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
    Annotated[LinkTime, Tag("constant")]
    | Annotated[ProfilePart, Tag("recorded")]
    | Annotated[ProfileFilePart, Tag("from a file")]
    | Annotated[SignalDelayPart, Tag("of a signal")]
    | Annotated[RangeDelayPart, Tag("of a range")],
    Discriminator(_kind_of_delay, custom_error_type="no_delay", custom_error_message=_NO_DELAY),
]


def _kind_of_loss(value: Any) -> str:
    if isinstance(value, ChainPart) or (isinstance(value, dict) and "kind" in value):
        return "in a chain"
    return "in bursts" if isinstance(value, dict | BurstPart) else "independent"


Loss = Annotated[
    Annotated[Probability, Tag("independent")]
    | Annotated[BurstPart, Tag("in bursts")]
    | Annotated[ChainPart, Tag("in a chain")],
    Discriminator(_kind_of_loss),
]


_Replayed: Any = part_of(Recording)


class RecordingPart(_Replayed):  # type: ignore[misc]
    """What became of recorded messages: { sent = [...], delays = [...], lost = [...] }."""

    sent: Annotated[list[LinkTime], Field(min_length=1)]
    """Instants of sending, from the first message on; they never decrease."""
    delays: list[LinkTime | Literal["in flight"]] | None = None
    """Time from sending to arrival, or until a lost message was due; without it the link's own."""
    lost: list[Annotated[int, Field(ge=0)]] = Field(default_factory=list)
    """Numbers of the messages that were lost, from 0."""


class RecordingFilePart(_Replayed):  # type: ignore[misc]
    """What became of recorded messages, from a log, a trace or another MCAP file."""

    file: Text
    """The file, from the folder of the scenario."""
    node: Text | None = None
    """Which link of a file with several; without it the one of this name, or the only one."""
    format: LogFormatPart | None = None
    """How a log is written: which columns say what, delimiter, unit of times, what means lost."""


def _kind_of_recording(value: Any) -> str | None:
    if not isinstance(value, dict | Part):
        return None
    keys = value if isinstance(value, dict) else type(value).model_fields
    return "inline" if "sent" in keys else "from a file"


_NO_RECORDING = "the name of a file, or a table with file, or with sent, delays and lost"


RecordedMessages = Annotated[
    Annotated[RecordingPart, Tag("inline")] | Annotated[RecordingFilePart, Tag("from a file")],
    Discriminator(
        _kind_of_recording,
        custom_error_type="no_recording",
        custom_error_message=_NO_RECORDING,
    ),
    BeforeValidator(
        lambda value: {"file": value} if isinstance(value, str) else value,
        json_schema_input_type=Text | RecordingPart | RecordingFilePart,
    ),
]

_KIND = Field(description="Sampled messages, or a continuous signal, delayed.")
_Packet: Any = part_of(
    PacketLink,
    first={"kind": (Annotated[Literal["packet"], _KIND], ...)},
    delay=(RecordedDelay, 0.0),
    jitter=(JitterPart | None, None),
    loss=(Loss, 0.0),
    optional=("seed",),
)
_Transport: Any = part_of(
    TransportLink,
    first={"kind": (Annotated[Literal["transport"], _KIND], ...)},
    delay=(RecordedDelay, ...),
)


class PacketPart(_Packet):  # type: ignore[misc]
    """[links.NAME] with kind = "packet"; without `seed` the seed of the run."""

    recording: RecordedMessages | None = None
    """What became of each message of a recorded link: a file, or a table."""
    greatest_age: LinkTime = 0.0
    """Age from which on `on_age` comes out in place of the message in use; 0: no watchdog."""
    on_age: Literal["zero", "hold"] | Number = "zero"
    """What comes out in place of a message that is too old; a value that is held is refused, since
    no proof covers it.
    """
    medium: Name | None = None
    """Medium that the link shares with others; without it the link has a channel of its own."""
    sender: Name | None = Field(default=None, alias="from")
    """Node of the medium that sends."""
    receiver: Name | None = Field(default=None, alias="to")
    """Node of the medium that receives."""
    packet: Name | None = None
    """Packets that links of one sender share: sent once, and heard by the receiver of each."""

    @model_validator(mode="after")
    def _hop(self) -> Self:
        if len({key is None for key in (self.medium, self.sender, self.receiver)}) > 1:
            raise ValueError("medium, from and to go together: a link from one node to another")
        if self.packet is not None and self.medium is None:
            raise ValueError("links share their packets on a medium: packet needs medium")
        return self


class TransportPart(_Transport):  # type: ignore[misc]
    """[links.NAME] with kind = "transport"; its delay is constant or recorded."""


LinkPart = Annotated[PacketPart | TransportPart, Field(discriminator="kind")]
