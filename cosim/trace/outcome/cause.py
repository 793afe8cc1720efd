"""The typed cause of a run that did not go from its start to its end."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self, cast

from pydantic import StrictFloat
from pydantic.dataclasses import dataclass

from cosim.core import ComponentError
from cosim.trace.outcome.read_json import AsJson, as_text, or_else

CauseKind = Literal[
    "refused",
    "crashed",
    "exited",
    "timed-out",
    "memory",
    "interrupted",
    "diverged",
    "not-finite",
    "delay",
    "unsettled",
    "altered",
    "asked-to-end",
    "event",
]
"""What ended a run, as a word that programs compare."""

_FAILURES: Final = frozenset(
    {
        *("refused", "crashed", "exited", "timed-out", "memory", "not-finite", "delay"),
        *("unsettled", "altered"),
    }
)


@dataclass(frozen=True)
class Cause(AsJson):
    """Why a run ended before its end, or what failed after it.

    Attributes
    ----------
    kind : refused: an FMI call returned an error; crashed: a signal ended the process of the
        slaves; exited: it left by exit(); timed-out: it exceeded a limit of time; memory: it
        exceeded the limit of memory; interrupted: Ctrl-C or SIGTERM; diverged, not-finite: an
        output left its range, or is no number; delay: a signal gave no valid delay of a link;
        unsettled: the values of an algebraic loop do not settle; altered: a component has written
        to rows that were complete;
        asked-to-end: a component; event: an event of the scenario stopped it.
    component, call : the component and the FMI call in progress; None where there is none.
    time_s : simulated time of the call [s]; None before the slaves are initialised.
    detail : in words.
    version : of these keys; it grows when one changes its meaning.
    """

    kind: CauseKind
    component: Annotated[str | None, as_text()] = None
    call: Annotated[str | None, as_text()] = None
    time_s: Annotated[StrictFloat | None, or_else(None)] = None
    detail: Annotated[str | None, as_text()] = None
    version: Annotated[int, or_else(1)] = 1

    @classmethod
    def of_error(cls, error: ComponentError, time_s: float | None) -> Self:
        """Return the cause that an error of a component is, at a time [s]."""
        kind = cast("CauseKind", error.kind or "refused")
        return cls(kind, error.component, error.call, time_s, error.detail or error.text())

    @property
    def words(self) -> str:
        """Say kind, component, FMI call and time in one line."""
        facts = [self.kind.replace("-", " ")]
        facts += [f"component {self.component}"] if self.component else []
        facts += [self.call] if self.call else []
        facts += [f"t = {self.time_s:g} s"] if self.time_s is not None else []
        return ", ".join(facts)

    @property
    def failure(self) -> bool:
        """Whether something failed, so that the command exits with 4."""
        return self.kind in _FAILURES
