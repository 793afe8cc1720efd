"""Random impairments of a link, declared: jitter, and loss in bursts or in windows.

`cosim.network.draws` draws from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from cosim.core import InputError
from cosim.network.checks import check_choice, check_duration, check_probability


@dataclass(frozen=True, slots=True)
class LossWindow:
    """Another probability of loss for messages sent in [from_ns, until_ns): 1 is an outage."""

    from_ns: int
    until_ns: int
    loss: float

    def __post_init__(self) -> None:
        check_duration("loss window: from_ns", self.from_ns)
        check_duration("loss window: until_ns", self.until_ns, minimum=self.from_ns)
        check_probability("loss window: loss", self.loss)


JitterKind = Literal["none", "uniform", "exponential", "normal"]


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

    kind: JitterKind = "none"
    width_ns: int = 0
    mean_ns: int = 0
    sigma_ns: int = 0
    max_ns: int | None = None

    def __post_init__(self) -> None:
        check_choice("jitter.kind", "jitter", self.kind, get_args(JitterKind))
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
