"""Random impairments of a link, declared: jitter, and loss in bursts or in windows.

`cosim.network.draws` draws from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from cosim.core import InputError
from cosim.network.checks import check_duration
from cosim.network.keys import (
    ChoiceKey,
    DurationKey,
    ProbabilitiesKey,
    ProbabilityKey,
    check_keys,
)


@dataclass(frozen=True, slots=True)
class LossWindow:
    """Another probability of loss for messages sent in [from_ns, until_ns): 1 is an outage."""

    from_ns: Annotated[int, DurationKey("its beginning")]
    until_ns: Annotated[int, DurationKey("its end")]
    loss: Annotated[float, ProbabilityKey("probability of a loss in it")]

    def __post_init__(self) -> None:
        check_keys("loss window: ", self)
        check_duration("loss window: until_ns", self.until_ns, minimum=self.from_ns)


JitterKind = Literal["none", "uniform", "exponential", "normal"]

_KEYS: dict[str, tuple[str, ...]] = {
    "none": (),
    "uniform": ("width_ns",),
    "exponential": ("mean_ns", "max_ns"),
    "normal": ("sigma_ns", "mean_ns", "max_ns"),
}
"""Kind of jitter -> its keys; the first one is required."""


@dataclass(frozen=True, slots=True)
class Jitter:
    """Extra delay of each message, on top of the link's delay; independent, never negative.

        >>> from cosim.network import Jitter, PacketLink, deliver
        >>> jitter = Jitter("exponential", mean_ns=20 * 10**6, max_ns=10**8)
        >>> up = PacketLink("up", sample_time_ns=10**8, delay_ns=2 * 10**8, jitter=jitter)
        >>> counts = deliver(up, end_ns=10**10).statistics(10**10)
        >>> 0.2 < counts["mean_delay_s"] < counts["max_delay_s"] <= 0.3
        True

    So no message arrives before sent + delay. Fractions of a nanosecond are rounded (uniform:
    cut off).

    Parameters
    ----------
    kind : "none"; "uniform" on [0, width_ns); "exponential" with mean `mean_ns`; "normal"
        with mean `mean_ns` and standard deviation `sigma_ns`. The last two are truncated to
        [0, max_ns] (drawn again until they lie there); `mean_ns` and `sigma_ns` are those
        before truncation. A normal of mean 0 is thus a half-normal.
    width_ns, mean_ns, sigma_ns : those that `kind` needs [ns]; the others are 0.
    max_ns : largest extra delay [ns], None for no bound; at least mean_ns + sigma_ns, or
        nearly every draw would be rejected.
    """

    kind: Annotated[JitterKind, ChoiceKey("distribution", get_args(JitterKind))] = "none"
    width_ns: Annotated[int, DurationKey("uniform jitter is less than this")] = 0
    mean_ns: Annotated[
        int, DurationKey("mean of exponential or normal jitter, before truncation")
    ] = 0
    sigma_ns: Annotated[
        int, DurationKey("standard deviation of normal jitter, before truncation")
    ] = 0
    max_ns: Annotated[int | None, DurationKey("greatest exponential or normal jitter")] = None

    def __post_init__(self) -> None:
        check_keys("jitter.", self)
        own = _KEYS[self.kind]
        for key in ("width_ns", "mean_ns", "sigma_ns", "max_ns"):
            value, none = getattr(self, key), None if key == "max_ns" else 0
            if value != none and key not in own:
                raise InputError(
                    f"{self.kind!r} jitter has no {key}",
                    where=f"jitter.{key}",
                    expected=f"{none}, or another kind of jitter",
                    got=f"{value} ns",
                )
        if own:
            check_duration(f"jitter.{own[0]}", getattr(self, own[0]), minimum=1)
        if self.max_ns is not None:
            check_duration("jitter.max_ns", self.max_ns, minimum=self.mean_ns + self.sigma_ns)


@dataclass(frozen=True, slots=True)
class GilbertElliott:
    """Bursty loss: a two-state Markov chain, one transition per message, starting good.

        >>> from cosim.network import GilbertElliott, PacketLink, deliver
        >>> bursts = GilbertElliott(p_enter=0.02, p_exit=0.2)  # of 5 messages on average
        >>> up = PacketLink("up", sample_time_ns=10**8, loss=bursts, seed=1)
        >>> counts = deliver(up, end_ns=10**11).statistics(10**11)
        >>> counts["sent"], 0 < counts["lost"] < 200
        (1001, True)

    Parameters
    ----------
    p_enter, p_exit : probability of going from good to bad, from bad to good, before a message
        (the first message is sent in the good state).
    loss_good, loss_bad : probability of losing a message sent in that state.

    The long-run loss is (p_exit loss_good + p_enter loss_bad) / (p_enter + p_exit), the mean
    length of a stay in the bad state 1 / p_exit messages (Gilbert 1960, Elliott 1963).
    """

    p_enter: Annotated[float, ProbabilityKey("from the good to the bad state, per message")]
    p_exit: Annotated[float, ProbabilityKey("from the bad to the good state, per message")]
    loss_good: Annotated[float, ProbabilityKey("probability of a loss in the good state")] = 0.0
    loss_bad: Annotated[float, ProbabilityKey("probability of a loss in the bad state")] = 1.0

    def __post_init__(self) -> None:
        check_keys("loss.", self)

    @property
    def losses(self) -> tuple[float, ...]:
        """Probability of a loss in each state."""
        return self.loss_good, self.loss_bad

    @property
    def moves(self) -> tuple[tuple[float, ...], ...]:
        """Probability of going from each state to each other one, in order."""
        return (self.p_enter,), (self.p_exit,)


_MOST_STATES = 8
_ADDS_TO_ONE = 1e-9


@dataclass(frozen=True, slots=True)
class LossChain:
    """Loss in a chain of k hidden states: one transition per message, starting in the first.

        >>> from cosim.network import LossChain, PacketLink, deliver
        >>> chain = LossChain(
        ...     transitions=((0.95, 0.04, 0.01), (0.5, 0.5, 0.0), (0.1, 0.0, 0.9)),
        ...     loss=(0.0, 0.5, 1.0),  # clear, fading, out
        ... )
        >>> up = PacketLink("up", sample_time_ns=10**8, loss=chain)
        >>> counts = deliver(up, end_ns=10**11).statistics(10**11)
        >>> counts["sent"], 0 < counts["lost"] < 400
        (1001, True)

    Parameters
    ----------
    transitions : from each state (row) to each (column), before a message, k rows of k; what a
        row lacks to 1 by rounding is taken as staying. The first message is sent in state 0.
    loss : probability of losing a message sent in each state, k numbers.

    With k = 2 it draws what `GilbertElliott` draws. More states make runs of losses of several
    kinds: single ones, short fades, outages of minutes.

    Raises
    ------
    InputError : fewer than 2 states or more than 8, tables that do not fit, rows that do not add
        to 1.
    """

    transitions: Annotated[
        tuple[tuple[float, ...], ...],
        ProbabilitiesKey("from each state (row) to each, per message", 2, _MOST_STATES, rows=True),
    ]
    loss: Annotated[
        tuple[float, ...], ProbabilitiesKey("probability of a loss in each state", 2, _MOST_STATES)
    ]

    def __post_init__(self) -> None:
        check_keys("loss.", self)
        if len(self.loss) != len(self.transitions):
            raise InputError(
                "a chain has a loss for each state",
                where="loss.loss",
                expected=f"{len(self.transitions)} numbers, as transitions has rows",
                got=str(len(self.loss)),
            )
        for i, row in enumerate(self.transitions):
            if abs(sum(row) - 1.0) > _ADDS_TO_ONE:
                raise InputError(
                    "a row of the transitions does not add to 1",
                    where=f"loss.transitions[{i}]",
                    expected="1",
                    got=f"{sum(row):.12g}",
                )

    @property
    def losses(self) -> tuple[float, ...]:
        """Probability of a loss in each state."""
        return self.loss

    @property
    def moves(self) -> tuple[tuple[float, ...], ...]:
        """Probability of going from each state to each other one, in order."""
        return tuple(row[:i] + row[i + 1 :] for i, row in enumerate(self.transitions))
