"""The typed cause of a run that did not go from its start to its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal, Self, cast, get_args

from cosim.core import ComponentError

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

VERSION: Final = 1
"""Of what `Cause.to_json` returns; it grows when a key changes its meaning."""
_KINDS: Final = frozenset(get_args(CauseKind))
_FAILURES: Final = frozenset(
    {
        *("refused", "crashed", "exited", "timed-out", "memory", "not-finite", "delay"),
        *("unsettled", "altered"),
    }
)


@dataclass(frozen=True)
class Cause:
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
    """

    kind: CauseKind
    component: str | None = None
    call: str | None = None
    time_s: float | None = None
    detail: str | None = None

    @classmethod
    def of_error(cls, error: ComponentError, time_s: float | None) -> Self:
        """Return the cause that an error of a component is, at a time [s]."""
        kind = cast("CauseKind", error.kind or "refused")
        return cls(kind, error.component, error.call, time_s, error.detail or error.text())

    @classmethod
    def from_json(cls, data: Any) -> Self | None:
        """Return the cause of a JSON object, as `to_json` makes it; None for anything else."""
        if not isinstance(data, dict) or data.get("kind") not in _KINDS:
            return None
        texts = (data.get(key) for key in ("component", "call", "detail"))
        component, call, detail = (None if text is None else str(text) for text in texts)
        at = data.get("time_s")
        time_s = float(at) if isinstance(at, int | float) and not isinstance(at, bool) else None
        return cls(cast("CauseKind", data["kind"]), component, call, time_s, detail)

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

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object with a version."""
        return {
            "version": VERSION,
            "kind": self.kind,
            "component": self.component,
            "call": self.call,
            "time_s": self.time_s,
            "detail": self.detail,
        }
