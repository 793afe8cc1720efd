"""[modes.NAME]: a mode machine: states, and the transitions between them.

A machine is in one of its states, from the first one listed, or `initial`, on. After every
communication point the transitions from the present state are looked at in the order in which they
are written; the first one whose condition holds, and whose time in the state is over, is taken at
the next point: the state is left (`exit`, and what was done `during` it is undone), entered
(`during`, `enter`), and the row of that point is in the new state. A machine takes one transition
at a point at most, after the events that are due there.

In conditions `NAME.STATE` is whether the machine is in that state, and `NAME.time` how long it has
been in its present one. `NAME.STATE` and `NAME.number`, from 0, may be the source of connections.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from cosim.master import MODE_NUMBER
from cosim.scenario.events import ActionsPart, Condition
from cosim.scenario.fields import Delay, Name, Part

TIME_IN_STATE = "time"
"""Name of the time in the present state."""


class StatePart(Part):
    """[modes.NAME.states.STATE]: what is done in a state."""

    enter: ActionsPart | None = None
    """What is done when the state is entered, also at the start of the run."""
    exit: ActionsPart | None = None
    """What is done when the state is left."""
    during: ActionsPart | None = None
    """What is done when the state is entered and undone when it is left: `set` restores the old
    values, `override` and `bias` are released, links are as before.
    """


class TransitionPart(Part):
    """[[modes.NAME.transitions]]: from one state to another."""

    source: Annotated[Name | list[Name] | None, Field(alias="from")] = None
    """State, or states, from which it leads; without it every state but `to`."""
    target: Name = Field(alias="to")
    """State to which it leads; from itself it begins the state anew."""
    when: Condition | None = None
    """Condition that must hold; it need not have become true in this state."""
    after: Delay | None = None
    """Time that must be spent in the state before."""

    def sources(self, states: Iterable[str]) -> list[str]:
        """Return the states from which it leads, of all `states`."""
        if self.source is None:
            return [name for name in states if name != self.target]
        return [self.source] if isinstance(self.source, str) else self.source

    @property
    def words(self) -> str:
        """Return what it waits for."""
        after = "" if self.after is None else f"after {self.after:g} s"
        when = "" if self.when is None else f"when {self.when}"
        return " and ".join(part for part in (after, when) if part)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.when is None and self.after is None:
            raise ValueError("a condition (when), or the time in the state (after)")
        return self


def _named(value: Any) -> Any:
    return {name: {} for name in value} if isinstance(value, list) else value


class ModesPart(Part):
    """[modes.NAME]: states and transitions; see `cosim.scenario.modes`."""

    initial: Name | None = None
    """State at the start of the run; without it the first one."""
    states: Annotated[
        dict[Name, StatePart],
        Field(min_length=1),
        BeforeValidator(_named, json_schema_input_type=dict[Name, StatePart] | list[Name]),
    ]
    """States by name, with what is done in them; or a list of names."""
    transitions: list[TransitionPart] = Field(default_factory=list)
    """The first one that can be taken is taken."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        for taken in {TIME_IN_STATE, MODE_NUMBER} & self.states.keys():
            raise ValueError(f"a state cannot be called {taken}: NAME.{taken} is another thing")
        used = [self.initial, *(t.target for t in self.transitions)]
        used += [name for t in self.transitions for name in t.sources(self.states)]
        for name in used:
            if name is not None and name not in self.states:
                raise ValueError(f"states: {', '.join(self.states)}; {name!r} is none of them")
        return self

    @property
    def first(self) -> str:
        """The state at the start of the run."""
        return self.initial or next(iter(self.states))
