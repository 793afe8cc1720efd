"""Random impairments of a link, declared: jitter, and loss in bursts or in windows.

`cosim.network.draws` draws from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from cosim.core import InputError
from cosim.network.checks import check_duration
from cosim.network.keys import ChoiceKey, DurationKey, ProbabilityKey, check_keys


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
