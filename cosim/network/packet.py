"""A packet link: sampled messages with delay, jitter, loss, order and quantization.

The declaration alone; `cosim.network.schedule` turns it into a schedule. The terms are those
of networked control: messages are sent at offset + k sample_time, each is on its way for
delay + jitter, some are lost, and the receiver holds what it last accepted.

All times are integer nanoseconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from cosim.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

JitterKind = Literal["none", "uniform", "exponential", "normal"]
Order = Literal["newest-wins", "fifo", "as-arrived"]

MAX_NS = 2**53
"""Longest duration a link takes: 104 days. Up to here a double counts nanoseconds exactly."""


def check_duration(where: str, value: Any, *, minimum: int = 0) -> None:
    """Raise `InputError` unless `value` is an integer of nanoseconds in [minimum, 2**53]."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InputError(
            "a duration is an integer number of nanoseconds",
            where=where,
            expected="an integer",
            got=f"{value!r} ({type(value).__name__})",
            hint="multiply seconds by 10**9 and round",
        )
    if not minimum <= value <= MAX_NS:
        raise InputError(
            "duration out of range",
            where=where,
            expected=f"{minimum} to 2**53 ns",
            got=f"{value} ns",
        )


def check_probability(where: str, value: Any) -> None:
    """Raise `InputError` unless `value` is a number in [0, 1]."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise InputError(
            "a probability is a number",
            where=where,
            expected="a number from 0 to 1",
            got=f"{value!r} ({type(value).__name__})",
        )
    if not 0.0 <= value <= 1.0:
        raise InputError(
            "probability out of range",
            where=where,
            expected="a number from 0 to 1",
            got=repr(value),
        )


def _check_name(where: str, name: Any) -> None:
    if not isinstance(name, str) or not name:
        raise InputError(
            "a link needs a name", where=where, expected="a non-empty string", got=repr(name)
        )


@dataclass(frozen=True, slots=True)
class Jitter:
    """Extra delay of each message, on top of the link's delay; independent, never negative.

    It is never negative so that `delay_ns` stays a bound: no message arrives before
    sent + delay. Fractions of a nanosecond are rounded (uniform: cut off).

    Parameters
    ----------
    kind : "none"; "uniform" on [0, width_ns); "exponential" with mean `mean_ns`; "normal"
        with mean `mean_ns` and standard deviation `sigma_ns`. The last two are conditioned on
        lying in [0, max_ns] (drawn again until they do), so `mean_ns` and `sigma_ns` are those
        before truncation. A normal of mean 0 is thus a half-normal.
    width_ns, mean_ns, sigma_ns : as `kind` asks [ns]; 0 where it does not.
    max_ns : largest extra delay [ns], None for no bound; at least mean_ns + sigma_ns, or
        nearly every draw would be refused.
    """

    kind: JitterKind = "none"
    width_ns: int = 0
    mean_ns: int = 0
    sigma_ns: int = 0
    max_ns: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(JitterKind):
            raise InputError(
                "unknown jitter",
                where="jitter.kind",
                expected="one of " + ", ".join(get_args(JitterKind)),
                got=repr(self.kind),
            )
        needed = {"uniform": "width_ns", "exponential": "mean_ns", "normal": "sigma_ns"}
        used = {needed.get(self.kind)} | ({"mean_ns"} if self.kind == "normal" else set())
        for key in ("width_ns", "mean_ns", "sigma_ns"):
            value = getattr(self, key)
            check_duration(f"jitter.{key}", value, minimum=int(key == needed.get(self.kind)))
            if value and key not in used:
                raise InputError(
                    f"{self.kind!r} jitter has no {key}",
                    where=f"jitter.{key}",
                    expected="0, or another kind of jitter",
                    got=f"{value} ns",
                )
        if self.max_ns is None:
            return
        if self.kind not in ("exponential", "normal"):
            raise InputError(
                f"{self.kind!r} jitter has no max_ns",
                where="jitter.max_ns",
                expected="None, or exponential or normal jitter",
                got=f"{self.max_ns} ns",
            )
        check_duration("jitter.max_ns", self.max_ns, minimum=self.mean_ns + self.sigma_ns)


@dataclass(frozen=True, slots=True)
class GilbertElliott:
    """Bursty loss: a two-state Markov chain, one transition per message, starting good.

    Parameters
    ----------
    p_enter, p_exit : probability of going from good to bad, from bad to good, before a message
        (the first message is sent in the good state).
    loss_good, loss_bad : probability of losing a message sent in that state.

    The long-run loss is (p_exit loss_good + p_enter loss_bad) / (p_enter + p_exit), the mean
    length of a stay in the bad state 1 / p_exit messages (Gilbert 1960, Elliott 1963).
    """

    p_enter: float
    p_exit: float
    loss_good: float = 0.0
    loss_bad: float = 1.0

    def __post_init__(self) -> None:
        for key in ("p_enter", "p_exit", "loss_good", "loss_bad"):
            check_probability(f"loss.{key}", getattr(self, key))


@dataclass(frozen=True, slots=True)
class PacketLink:
    """A link that carries sampled messages.

    Parameters
    ----------
    name : name of the link; its random streams depend on it.
    sample_time_ns : time between two messages [ns], > 0.
    offset_ns : instant of the first message [ns].
    delay_ns : least time from sending to arrival [ns].
    jitter : extra delay of each message.
    loss : probability that a message is lost (independent), or bursts.
    order : "newest-wins": a message that arrives after a newer one is discarded ("overtaken");
        "fifo": a message is delivered not before its predecessors; "as-arrived": every message
        is used when it arrives, however old.
    on_loss : what the receiver uses after a loss. "hold": the message it has. "zero" or a
        number: that value, from the instant the lost message was due (sent + delay + its
        jitter; under fifo not before its predecessors) until the next message is accepted,
        but only if no newer message had been delivered by then.
    data_rate, frame_size : bit/s (integer) and bits of a message, headers included; 0: a message
        takes no time to send. Else each takes frame_size / data_rate, and one that is due while
        another is still being sent waits for it (losses happen later, so they take their turn).
    quantization : step of the quantizer applied to the values sent; 0: none.
    seed : seed of the run (0 to 2**63 - 1). Two links of one run share it and still draw
        independently, since their names differ.

    Raises
    ------
    InputError : a parameter out of its range; the message names it.
    """

    name: str
    sample_time_ns: int
    offset_ns: int = 0
    delay_ns: int = 0
    jitter: Jitter = field(default_factory=Jitter)
    loss: float | GilbertElliott = 0.0
    order: Order = "newest-wins"
    on_loss: Literal["hold", "zero"] | float = "hold"
    quantization: float = 0.0
    seed: int = 0
    data_rate: int = 0
    frame_size: int = 0

    def __post_init__(self) -> None:
        _check_name("link", self.name)
        where = f"link {self.name!r}"
        check_duration(f"{where}: sample_time_ns", self.sample_time_ns, minimum=1)
        check_duration(f"{where}: offset_ns", self.offset_ns)
        check_duration(f"{where}: delay_ns", self.delay_ns)
        if not isinstance(self.jitter, Jitter):
            raise InputError(
                "jitter of the wrong type",
                where=f"{where}: jitter",
                expected="a Jitter",
                got=repr(self.jitter),
            )
        if not isinstance(self.loss, GilbertElliott):
            check_probability(f"{where}: loss", self.loss)
        if self.order not in get_args(Order):
            raise InputError(
                "unknown order",
                where=f"{where}: order",
                expected="one of " + ", ".join(get_args(Order)),
                got=repr(self.order),
            )
        if self.on_loss not in ("hold", "zero") and not _is_finite(self.on_loss):
            raise InputError(
                "unknown action on loss",
                where=f"{where}: on_loss",
                expected="hold, zero, or a finite number",
                got=repr(self.on_loss),
            )
        # below 1e-100 the number of steps in an ordinary value is no longer finite
        if not _is_finite(self.quantization) or not (
            self.quantization == 0 or self.quantization >= 1e-100
        ):
            raise InputError(
                "quantization step out of range",
                where=f"{where}: quantization",
                expected="0 (none), or a finite number from 1e-100 up",
                got=repr(self.quantization),
            )
        for key in ("data_rate", "frame_size"):
            value = getattr(self, key)
            if not _is_integer(value) or not 0 <= value <= MAX_NS:
                raise InputError(
                    f"{key} out of range",
                    where=f"{where}: {key}",
                    expected="an integer from 0 (none) to 2**53",
                    got=repr(value),
                )
        if (self.data_rate == 0) != (self.frame_size == 0):
            raise InputError(
                "a data rate and a frame size go together",
                where=f"{where}: data_rate, frame_size",
                expected="both or neither",
                got=f"{self.data_rate} bit/s, {self.frame_size} bit",
            )
        check_duration(f"{where}: frame_size / data_rate", self.frame_ns)
        if not _is_integer(self.seed) or not 0 <= self.seed < 2**63:
            raise InputError(
                "seed out of range",
                where=f"{where}: seed",
                expected="an integer from 0 to 2**63 - 1",
                got=repr(self.seed),
            )

    @property
    def frame_ns(self) -> int:
        """Time to send one message, frame_size / data_rate rounded up [ns]; 0 without a rate."""
        if self.data_rate == 0:
            return 0
        return -(-int(self.frame_size) * 10**9 // int(self.data_rate))

    @property
    def substitute(self) -> float | None:
        """The value used after a loss; None when the last message is held."""
        if self.on_loss == "hold":
            return None
        return 0.0 if self.on_loss == "zero" else float(self.on_loss)

    def quantize(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """`values` rounded to the nearest multiple of the step (ties to even); a new array."""
        if self.quantization == 0.0:
            return np.array(values, dtype=np.float64)
        return np.rint(np.asarray(values, np.float64) / self.quantization) * self.quantization


def _is_integer(value: Any) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        return False
    return math.isfinite(value)
