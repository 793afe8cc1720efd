"""A kind of loop as designed: a scenario that must claim its guarantee, and what is proved of it.

All kinds are unstable when open, or outside a window of ages, so that a claim beside a broken loop
shows as a state that grows. Each has two flights: from an offset without disturbance, where no
state may grow, and from rest with a pulse, where the gain may not pass gamma.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

Data = dict[str, Any]
MS = 1_000_000


@dataclass(frozen=True)
class Age:
    """What is proved of one age, in whole nanoseconds.

    Attributes
    ----------
    name : measurement, or state; "command" for that of an observer's estimate.
    inputs : those of the controller, or of the plant, that it is the age of.
    link : the link that a fault makes slower.
    least_ns, greatest_ns : bounds, contained.
    """

    name: str
    inputs: tuple[str, ...]
    link: str
    greatest_ns: int
    least_ns: int = 0


@dataclass(frozen=True)
class Loop:
    """A kind of loop.

    Attributes
    ----------
    name, words : of the kind.
    scenario : as designed, from an offset.
    pushed : the same from rest with a disturbance; None: that flight is not made.
    ages : what is proved of them.
    states, controls, disturbances : variables of the plant.
    initial : parameter of the plant that is the initial value of each state.
    unproved : why the loop as designed may not be claimed; empty if it must be.
    plant_delay : "exactly" or "up to" where the plant has a delay of its own.
    """

    name: str
    words: str
    scenario: Data
    driven: Data | None
    ages: tuple[Age, ...]
    states: tuple[str, ...] = ("x[1]", "x[2]")
    controls: tuple[str, ...] = ("u[1]",)
    disturbances: tuple[str, ...] = ("w[1]",)
    initial: tuple[str, ...] = ("initial.x[1]", "initial.x[2]")
    unproved: str = ""
    plant_delay: str = ""
    parameters: tuple[str, ...] = field(default=("A[2,1]", "B[2,1]", "C[2,1]"))

    @property
    def observed(self) -> bool:
        """Whether there is an observer: measurements with stamps."""
        wires = self.scenario["connections"]
        return any(each["to"].startswith("controller.stamp") for each in wires)


def wire(source: str, target: str, link: str | None = None) -> Data:
    return {"from": source, "to": target} | ({} if link is None else {"link": link})


def packet(delay: float, sample_time: float = 0.05) -> Data:
    """A packet link that loses nothing."""
    return {"kind": "packet", "sample_time": sample_time, "delay": delay}


def transport(delay: float) -> Data:
    """A transport link."""
    return {"kind": "transport", "delay": delay}
