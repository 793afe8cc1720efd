"""A scenario to be broken: a copy of a loop's, with names for what a fault takes hold of."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from random import Random
from typing import TypeVar

from falsifier.loop import Data, Loop

T = TypeVar("T")


class NotHere(Exception):  # noqa: N818 - no error: a kind of loop has nothing for this fault
    """A fault has nothing to break in this kind of loop."""


class Draft:
    """A scenario of a loop that a fault changes in place.

    Attributes
    ----------
    loop : the kind.
    data : the scenario.
    dice : draws which wire, and how much; None in the matrix, where it is the first and a lot.
    """

    def __init__(self, loop: Loop, data: Data, dice: Random | None = None) -> None:
        self.loop, self.data, self.dice = loop, deepcopy(data), dice

    # what there is

    @property
    def wires(self) -> list[Data]:
        """The connections."""
        found: list[Data] = self.data["connections"]
        return found

    @property
    def components(self) -> Data:
        """The components."""
        found: Data = self.data["components"]
        return found

    @property
    def links(self) -> Data:
        """The links."""
        found: Data = self.data.setdefault("links", {})
        return found

    def measured(self) -> list[Data]:
        """The wires out of the plant's state into sensors or controller."""
        states = {f"plant.{x}" for x in self.loop.states}
        aside = ("listener.", "twin.")  # beside the loop, where nothing can be broken
        return [x for x in self.wires if x["from"] in states and not x["to"].startswith(aside)]

    def received(self) -> list[Data]:
        """The wires that carry measurements into the controller."""
        measured = ("controller.stamp.", "controller.reference")
        wires = [x for x in self.wires if x["to"].startswith("controller.")]
        return [x for x in wires if not x["to"].startswith(measured)]

    def stamps(self) -> list[Data]:
        """The wires of stamps into the controller."""
        return [x for x in self.wires if x["to"].startswith("controller.stamp.")]

    def commands(self) -> list[Data]:
        """The wires from the controller to the plant."""
        return [
            x
            for x in self.wires
            if x["from"].startswith("controller.") and x["to"].startswith("plant.")
        ]

    def sensors(self) -> list[str]:
        """The sensors of an observer."""
        names = dict.fromkeys(x["from"].partition(".")[0] for x in self.stamps())
        return [x for x in names if x in self.components]

    # what is drawn

    def pick(self, choices: Sequence[T]) -> T:
        """One of several: the first, or a drawn one; `NotHere` if there is none."""
        if not choices:
            raise NotHere
        return choices[0] if self.dice is None else self.dice.choice(choices)

    def size(self, much: float, least: float | None = None) -> float:
        """How large a fault is: much, or drawn between the least that is one and much."""
        if self.dice is None:
            return much
        low = much / 10 if least is None else least
        share = self.dice.random()
        return low * (much / low) ** share if low > 0 else share * much

    # what is done

    def parameters(self, component: str) -> Data:
        """The parameters of a component, to be written."""
        found: Data = self.components[component].setdefault("parameters", {})
        return found

    def relink(self, wire: Data, name: str, link: Data) -> None:
        """Lead a wire over another link."""
        self.links[name] = link
        wire["link"] = name

    def computed(self, name: str, expression: str) -> str:
        """Return the output of a computed value that is added."""
        self.data.setdefault("computed", {}).setdefault(name, {})["v"] = expression
        return f"{name}.v"

    def event(self, **what: object) -> None:
        """Add an event."""
        self.data.setdefault("events", []).append(what)

    def series(self, target: str, times: list[float], values: list[float]) -> None:
        """Let an input follow a series."""
        part = {"times": times, "values": {target: values}, "interpolation": "hold"}
        self.data.setdefault("inputs", []).append(part)

    def needs(self, there: object) -> None:
        """Raise `NotHere` where the kind has not what a fault needs."""
        if not there:
            raise NotHere
