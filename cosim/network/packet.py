"""A packet link: sampled messages with delay, jitter, loss, copies, order and quantization.

The declaration; `cosim.network.delivery` says what becomes of it. Messages are sent at
offset + k sample_time, each takes delay + jitter, some are lost, and the receiver holds the one
it last accepted. All times are integer nanoseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network.checks import check_delay, check_duration, check_name, is_finite
from cosim.network.delay_signal import DelaySignal
from cosim.network.impairment import GilbertElliott, Jitter, LossChain, LossWindow
from cosim.network.keys import (
    ChoiceKey,
    CountKey,
    DurationKey,
    NumberKey,
    ProbabilityKey,
    TableKey,
    WordOrNumberKey,
    check_keys,
)
from cosim.network.medium import Hop
from cosim.network.profile import DelayProfile
from cosim.network.recording import Recording, check_recording

Order = Literal["newest-wins", "fifo", "as-arrived"]
"""Which messages a packet link delivers, and in which order."""

OnLoss = Literal["hold", "zero"]


@dataclass(frozen=True, slots=True)
class PacketLink:
    """A link that transmits sampled messages.

        >>> from cosim.network import PacketLink, deliver
        >>> up = PacketLink("up", sample_time_ns=10**8, delay_ns=3 * 10**8, loss=0.1, seed=1)
        >>> sent = deliver(up, end_ns=10**10)
        >>> sent.sent_in_use([0, 10**9]).tolist()  # of the message in use [ns]; -1: none yet
        [-1, 700000000]
        >>> counts = sent.statistics(10**10)
        >>> counts["sent"], counts["in_flight"], counts["delivered"] + counts["lost"]
        (101, 3, 98)

    Parameters
    ----------
    name : name of the link; its random streams depend on it.
    sample_time_ns : time between two messages [ns], positive.
    offset_ns : instant of the first message [ns].
    delay_ns : least time from sending to arrival [ns].
    delay : in place of `delay_ns`, a delay that varies: a `DelayProfile` (recorded) or a
        `DelaySignal` (known only during the run: `Delivery`); the value at the instant of
        sending counts.
    jitter : extra delay of each message.
    loss : probability that a message is lost (independent), or bursts.
    duplicate : probability that a message which is not lost arrives twice. The network copies it
        after the sender's queue, so that it takes sending time at a limited `data_rate` once;
        the copy has the same sequence number and its own jitter.
    playout_ns : a play-out buffer at the receiver: a message that arrives no later than sent +
        playout is released at exactly that instant, so that its age is then always the same; a
        message that arrives later is discarded ("late"). A loss is also noticed at sent + playout,
        and a late message counts as one. `order` acts on the way to the buffer, on copies and,
        under fifo, on messages that wait for their predecessors; the buffer itself releases in
        order of sending. On a grid a message is released at the first point at or after sent +
        playout, if it arrived by that instant itself. 0: no buffer.
    order : "newest-wins": a message that arrives after a newer one is discarded ("overtaken"),
        and so is one that arrives a second time ("duplicate"); "fifo": a message is not
        delivered before its predecessors, its copy after it and before its successors;
        "as-arrived": every message is used when it arrives, however old. The last two also
        use copies.
    on_loss : what the receiver uses after a loss. "hold": the last message. "zero" or a number:
        that value, from the instant the lost message was due (sent + delay + its jitter; under
        fifo not before its predecessors) until the next message is accepted, unless a newer
        message was delivered by then.
    data_rate, frame_size : bit/s (integer) and bits of a message, headers included; 0: a message
        takes no time to send. Else each takes frame_size / data_rate, lost ones included, and
        waits while another is being sent.
    queue_limit : how many messages may wait while another is being sent; one more is refused
        ("queue full", drop-tail) at the instant of sending, without effect on the receiver
        (`on_loss` does not act). None: no limit. Only with a `data_rate`.
    recording : what became of each message of a recorded link; its delays and losses replace
        `delay`, `jitter` and `loss`. All other keys act on these messages as on any others.
    greatest_age_ns : a watchdog at the receiver: at points at which the message in use was sent as
        long ago as this, or longer, `on_age` is used in its place. Between points the message gets
        older: for an age that must never be exceeded, leave room for the receiver's step. 0: none.
    on_age : what the receiver uses in place of a message that is too old: "zero" or a number.
    hop : the way over a medium that the link shares with others: its packets wait in the queue of
        their node for access to the medium, take its airtime and its travel time, and then `delay`
        and jitter. `data_rate` is the medium's; a recording, `duplicate` and a `DelaySignal` are
        not allowed. None: a channel of its own.
    windows : times with another loss; where windows overlap, the last one counts. Jitter, and
        losses outside the windows, are the same as without windows.
    quantization : step of the quantizer applied to the values sent; 0: none.
    adjustable : whether delay and loss may be changed while the run goes on: each message is then
        resolved when it is sent (`Delivery.resolve`).
    seed : seed of the run (0 to 2**63 - 1); links with different names draw independently.

    Raises
    ------
    InputError : a parameter out of its range; the message names it.
    """

    name: str
    sample_time_ns: Annotated[int, DurationKey("time between two messages", least_ns=1)]
    offset_ns: Annotated[int, DurationKey("instant of the first message")] = 0
    delay_ns: Annotated[int, DurationKey("least time from sending to arrival")] = 0
    playout_ns: Annotated[
        int, DurationKey("age at which messages are released, later ones discarded; 0: no buffer")
    ] = 0
    jitter: Annotated[Jitter, TableKey("extra delay of each message", Jitter)] = field(
        default_factory=Jitter
    )
    loss: Annotated[
        float | GilbertElliott | LossChain,
        ProbabilityKey("probability of a loss", (GilbertElliott, LossChain)),
    ] = 0.0
    duplicate: Annotated[
        float, ProbabilityKey("probability that what is not lost arrives twice")
    ] = 0.0
    order: Annotated[Order, ChoiceKey("order of delivery", get_args(Order))] = "newest-wins"
    on_loss: Annotated[
        OnLoss | float, WordOrNumberKey("what comes out after a loss", get_args(OnLoss))
    ] = "hold"
    # below 1e-100 the number of steps in an ordinary value is no longer finite
    quantization: Annotated[float, NumberKey("step of the values sent; 0: none", 1e-100)] = 0.0
    data_rate: Annotated[
        int, CountKey("bits per second, whole; 0: sending takes no time", unit="bit/s")
    ] = 0
    frame_size: Annotated[int, CountKey("bits of a message", unit="bit")] = 0
    queue_limit: Annotated[int | None, CountKey("messages that may wait")] = None
    seed: Annotated[int, CountKey("seed of the run", most=2**63 - 1)] = 0
    delay: DelayProfile | DelaySignal | None = None
    greatest_age_ns: int = 0
    on_age: Literal["zero"] | float = "zero"
    windows: tuple[LossWindow, ...] = ()
    recording: Recording | None = None
    hop: Hop | None = None
    adjustable: bool = False

    def __post_init__(self) -> None:
        check_name("link", self.name)
        where = f"link {self.name!r}"
        check_keys(f"{where}: ", self)
        hint = "a delay that does not vary is delay_ns"
        check_delay(where, self.delay, self.delay_ns, (DelayProfile, DelaySignal), hint)
        given = {
            "delay": self.delay is not None or self.delay_ns > 0,
            "jitter": self.jitter.kind != "none",
            "loss": self.loss != 0.0,
        }
        check_recording(where, self.recording, given)
        if self.hop is not None:
            self._check_hop(where, self.hop)
        elif (self.data_rate == 0) != (self.frame_size == 0):
            raise InputError(
                "a data rate and a frame size go together",
                where=f"{where}: data_rate, frame_size",
                expected="both or neither",
                got=f"{self.data_rate} bit/s, {self.frame_size} bit",
            )
        check_duration(f"{where}: frame_size / data_rate", self.frame_ns)
        if self.queue_limit is not None and self.data_rate == 0 and self.hop is None:
            raise InputError(
                "without a data rate there is no queue",
                where=f"{where}: queue_limit",
                expected="a data_rate and a frame_size, or None",
                got=repr(self.queue_limit),
            )
        self._check_greatest_age(where)
        if 0 < self.playout_ns < self.least_transit_ns:
            raise InputError(
                "every message would be late for its play-out",
                where=f"{where}: playout_ns",
                expected=f"at least {self.least_transit_ns} ns, the least that a message takes "
                f"({self.frame_ns} ns to send it, and its least delay), or 0 for no buffer",
                got=f"{self.playout_ns} ns",
                hint="delay + jitter + frame_size / data_rate + the wait in the queue must fit",
            )

    def _check_greatest_age(self, where: str) -> None:
        """Refuse a greatest age that nothing follows, or that no message keeps."""
        where = f"{where}: greatest_age_ns"
        check_duration(where, self.greatest_age_ns)
        if self.on_age != "zero" and not is_finite(self.on_age):
            raise InputError(
                "not what can take the place of a message that is too old",
                where=where.replace("greatest_age_ns", "on_age"),
                expected='"zero", or a number',
                got=repr(self.on_age),
                hint="a value that is held may be as old as an outage is long: no proof covers it",
            )
        instead = 0.0 if self.on_age == "zero" else self.on_age
        if self.greatest_age_ns and self._after_loss not in (None, instead):
            raise InputError(
                "what a loss and an age put in place of a message differ",
                where=where.replace("greatest_age_ns", "on_age"),
                expected=f'on_loss = "hold", or {instead:g} as on_age',
                got=f"on_loss = {self.on_loss!r}",
            )
        if 0 < self.greatest_age_ns <= max(self.least_transit_ns, self.playout_ns):
            raise InputError(
                "every message would be too old when it arrives",
                where=where,
                expected=f"more than the {max(self.least_transit_ns, self.playout_ns)} ns that a "
                "message takes, or 0 for no watchdog",
                got=f"{self.greatest_age_ns} ns",
            )

    def _check_hop(self, where: str, hop: Hop) -> None:
        """Check the size of messages, and that nothing is given that the medium says."""
        hop.check(where, self.frame_size)
        given: dict[str, bool] = {
            "data_rate": self.data_rate != 0,
            "recording": self.recording is not None,
            "duplicate": self.duplicate != 0.0,
            "delay": isinstance(self.delay, DelaySignal),
        }
        for key, is_given in given.items():
            if is_given:
                raise InputError(
                    f"a link over a medium has no {key} of this kind",
                    where=f"{where}: {key}",
                    expected="what the medium says of it, for all its links",
                    got=repr(getattr(self, key)),
                )

    @property
    def resolved_with(self) -> str:
        """Name of the object that determines its delays: the link, or its medium, medium.NAME."""
        return self.name if self.hop is None else f"medium.{self.hop.medium.name}"

    @property
    def is_live(self) -> bool:
        """Return whether the fate of a message is known only when it is sent."""
        moves = self.hop is not None and self.hop.medium.moves
        return self.adjustable or moves or isinstance(self.delay, DelaySignal)

    @property
    def frame_ns(self) -> int:
        """Return the time to send one message [ns], rounded up: its airtime on a medium; or 0."""
        if self.hop is not None:
            return self.hop.medium.airtime_ns(self.frame_size)
        if self.data_rate == 0:
            return 0
        return -(-int(self.frame_size) * 10**9 // int(self.data_rate))

    @property
    def least_transit_ns(self) -> int:
        """Return the least time from sending to arrival [ns], without the play-out buffer.

        Of a delay that follows a signal, of ranges, and of values that may be changed, only the
        sign is known.
        """
        if self.adjustable:
            return self.frame_ns
        least = self.delay_ns
        if isinstance(self.delay, DelayProfile):
            least = int(self.delay.delays_ns.min())
        if self.recording is not None:
            least += self.recording.least_ns
        return self.frame_ns + least

    @property
    def substitute(self) -> float | None:
        """Return the value used after a loss, or beyond the greatest age; None: there is none."""
        if self.greatest_age_ns:
            return 0.0 if self.on_age == "zero" else float(self.on_age)
        return self._after_loss

    @property
    def _after_loss(self) -> float | None:
        """Return the value used after a loss; None when the last message is held."""
        if self.on_loss == "hold":
            return None
        return 0.0 if self.on_loss == "zero" else float(self.on_loss)

    def quantize(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Round `values` to the nearest multiples of the step (ties to even); a new array."""
        if self.quantization == 0.0:
            return np.array(values, dtype=np.float64)
        return np.rint(np.asarray(values, np.float64) / self.quantization) * self.quantization
