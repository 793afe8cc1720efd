"""[[events]] and [[assertions]]: what happens during a run, and what must hold.

An event happens at a time (`at`) or when a condition becomes true (`when`). Conditions are
evaluated after every communication point; their events take effect at the next one, on links for
the messages that are sent from there on. An event at
a time takes effect at that time, which becomes a communication point (with events = "grid": at
the next point). Events due at one point happen in the order in which they are written.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from cosim.core import Number, Text
from cosim.scenario.binding import AnyName, bind
from cosim.scenario.expression import Expression
from cosim.scenario.fields import (
    Duration,
    FmiValue,
    Instant,
    LinkTime,
    Name,
    Part,
    Probability,
    Reference,
    Seconds,
    SignalValue,
)


def _condition(text: str) -> str:
    bind(Expression(text), AnyName())
    return text


Condition = Annotated[str, AfterValidator(_condition)]


class BiasPart(Part):
    """Replaces a value by factor * value + offset."""

    offset: SignalValue = 0.0
    """Added to the value."""
    factor: Number = 1.0
    """The value is multiplied by it first."""


class ActionsPart(Part):
    """What is done: by an event, or where a mode is entered or left."""

    set: dict[Reference, FmiValue] = Field(default_factory=dict)
    """New values of tunable parameters and unconnected inputs, by `component.variable`."""
    override: dict[Reference, SignalValue] = Field(default_factory=dict)
    """Values that outputs and connected inputs have instead of their own."""
    bias: dict[Reference, BiasPart] = Field(default_factory=dict)
    """Errors of outputs and connected inputs: factor and offset."""
    freeze: list[Reference] = Field(default_factory=list)
    """Outputs and connected inputs that keep the value that they have: a sensor that hangs."""
    release: list[Reference] = Field(default_factory=list)
    """Overrides, biases and freezes that end."""
    reset: list[Name] = Field(default_factory=list)
    """Components whose FMU returns to its start (FMI's reset; its time goes on)."""
    stop: Literal[True] | Text | None = None
    """The run ends, with this reason."""
    outage: list[Name] = Field(default_factory=list)
    """Links that deliver nothing. At a time: what is sent meanwhile is lost. On a condition: their
    receivers keep their values, whatever arrives; `loss` of 1 loses what is sent.
    """
    restore: list[Name] = Field(default_factory=list)
    """Links whose outage, delay or loss, changed by a condition, is as before."""
    delay: dict[Name, LinkTime] = Field(default_factory=dict)
    """New constant delays of links. On a condition, of packet links: of what is sent from then
    on.
    """
    loss: dict[Name, Probability] = Field(default_factory=dict)
    """New probabilities of loss of packet links, of what is sent from then on."""

    @property
    def acts(self) -> bool:
        """Whether anything is done."""
        acts = self.set or self.override or self.bias or self.outage or self.delay or self.loss
        acts = acts or self.freeze or self.release or self.reset or self.restore
        return bool(acts) or self.stop is not None


class OccasionPart(Part):
    """When an event happens, and for how long."""

    at: Seconds | None = None
    """Time at which the event happens; it becomes a communication point."""
    when: Condition | None = None
    """Condition that makes it happen when it becomes true, as in "plant.eta.z > 5 m"."""
    trigger: Literal["once", "every-time"] = "once"
    """Whether `when` counts the first time only, or every time it becomes true."""
    duration: Annotated[Duration | None, Field(alias="for")] = None
    """How long the event lasts; then `set` restores the old values, `override`, `bias` and `freeze`
    are released, and links are as before.
    """
    until: Instant | None = None
    """Time at which it ends, in place of `for`; with `at` only."""
    ends: Condition | None = None
    """Condition that ends it, in place of `for`; with `when` only. Two thresholds that lie apart
    make a switch with hysteresis.
    """


class EventPart(ActionsPart, OccasionPart):
    """[[events]]: at a time, or when a condition becomes true.

    Exactly one of `at` and `when`.
    """

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.at is None) == (self.when is None):
            raise ValueError("either at (a time) or when (a condition)")
        if self.at is not None and self.at < 0:
            raise ValueError(f"a time from 0 on: {self.at:g} s is in the past")
        if self.until is not None and self.at is None:
            raise ValueError("until goes with at; with when, say how long: for, or ends")
        if self.until is not None and self.duration is not None:
            raise ValueError("one of for and until")
        if self.until is not None and self.at is not None and self.until <= self.at:
            raise ValueError(f"until after at: {self.until:g} s is in the past at {self.at:g} s")
        if self.trigger == "every-time" and self.when is None:
            raise ValueError('trigger = "every-time" with a condition (when)')
        if self.ends is not None and (self.when is None or self.duration is not None):
            raise ValueError("ends goes with when, in place of for")
        if self.at is not None and self.restore:
            raise ValueError("restore ends what a condition began; by time an outage has until")
        if not self.acts:
            raise ValueError(
                "something that happens: set, override, bias, freeze, release, reset, stop, "
                "outage, restore, delay or loss"
            )
        return self


class WithinPart(Part):
    """`within`: each time `when` becomes true, `holds` must become true within `of`.

    Without `when` it counts from the beginning of the window.
    """

    of: Duration
    """Time within which it must become true."""
    holds: Condition
    """Condition that must become true."""
    when: Condition | None = None
    """Condition from which the time counts, each time it becomes true; without it, the beginning
    of the window.
    """


class AssertionPart(Part):
    """[[assertions]]: a condition on the communication points in [after, before].

    Exactly one of `always`, `eventually` and `within`.
    """

    name: Text | None = None
    """What the summary calls it; without a name, the condition."""
    always: Condition | None = None
    """Condition that holds at every communication point of the window."""
    eventually: Condition | None = None
    """Condition that holds at one communication point of the window at least."""
    within: WithinPart | None = None
    """Condition that holds soon after another one."""
    after: Instant | None = None
    """Beginning of the window; without it that of the run."""
    before: Instant | None = None
    """End of the window; without it that of the run."""
    expected: Literal["holds", "fails"] = "holds"
    """Or "fails": the assertion must not hold."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        given = [x for x in (self.always, self.eventually, self.within) if x is not None]
        if len(given) != 1:
            raise ValueError("exactly one of always, eventually and within")
        if self.after is not None and self.before is not None and self.before < self.after:
            raise ValueError("before not earlier than after")
        return self

    @property
    def words(self) -> str:
        """Return the assertion in one line."""
        window = "" if self.after is None else f" after {self.after:g} s"
        window += "" if self.before is None else f" before {self.before:g} s"
        if self.within is not None:
            since = f" of {self.within.when}" if self.within.when else ""
            return f"within {self.within.of:g} s{since}: {self.within.holds}{window}"
        if self.always is not None:
            return f"always {self.always}{window}"
        return f"eventually {self.eventually}{window}"
