"""Events of a run: what happened at which instant, and how often."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import StrictFloat, StrictInt
from pydantic.dataclasses import dataclass as validated

from cosim.trace.outcome.read_json import AsJson, as_text, or_else

EventKind = Literal[
    "saturation",
    "age",
    "envelope",
    "loss",
    "outage",
    "guarantee",
    "assertion",
    "warning",
    "failure",
    "scenario",
]
"""What kind of thing happened in a run."""

SERIOUS = frozenset({"warning", "error", "fatal"})
"""Levels of what a reader of the log must not miss."""
BURST = 3
"""Messages in a row that did not arrive and make a burst: one or two may be lost at any time."""

CONCLUSION = "run"
"""Name of the last lines of a log, which say how the run ended."""


@dataclass(frozen=True, slots=True)
class RunEvent:
    """Something that happened at an instant of a run; a line of `/log`.

    Attributes
    ----------
    time_ns : the instant [ns].
    level : of the line: "info", "warning", "error".
    kind : saturation: a command reached its limit, or left it; age: a measurement was older than
        designed for; envelope: the state left the envelope of the proof; loss: messages in a row
        did not arrive; outage: a link delivered nothing, as the scenario says; assertion: one was
        decided otherwise than expected; warning: a component logged one, or an error; failure:
        what broke the run off; scenario: an event of the scenario.
    subject : what it happened to: a component, a signal, a link; the name of the line.
    message : in words.
    """

    time_ns: int
    level: str
    kind: EventKind
    subject: str
    message: str


@validated(frozen=True, slots=True)
class EventCount(AsJson):
    """How often an event happened to a subject.

    Attributes
    ----------
    kind, subject, level, message : as of `RunEvent`, of the first one.
    count : how often.
    first_s : when first [s].
    total_s : how long in all [s]; None for what has no duration.
    """

    kind: EventKind
    subject: Annotated[str, as_text()]
    level: Annotated[str, as_text()]
    message: Annotated[str, as_text()]
    count: StrictInt
    first_s: StrictFloat
    total_s: Annotated[StrictFloat | None, or_else(None)] = None

    @property
    def serious(self) -> bool:
        """Whether it was a warning or an error."""
        return self.level in SERIOUS

    @property
    def words(self) -> str:
        """Say what happened, how often, and how long in all."""
        often = f"{self.count} times" if self.count > 1 else ""
        long = "" if self.total_s is None else f"{self.total_s:.4g} s"
        long += " in all" if often and long else ""
        extent = ", ".join(filter(None, (often, long)))
        return f"{self.subject}: {self.message}" + (f" ({extent})" if extent else "")


def counted(lines: Iterable[tuple[float, str, str, str]]) -> list[EventCount]:
    """Count equal lines of a log: time [s], level, name and message of each; serious ones only.

    For a run that left no outcome, of which its log is all there is.
    """
    found: dict[tuple[str, str, str], tuple[float, int]] = {}
    for time_s, level, name, message in lines:
        if level in SERIOUS and name != CONCLUSION:
            first, count = found.get((level, name, message), (time_s, 0))
            found[level, name, message] = first, count + 1
    return [
        EventCount("warning", name, level, message, count, first)
        for (level, name, message), (first, count) in found.items()
    ]
