"""How a run breaks off that the child cannot continue: cause and message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from cosim.core import DEATH_HINTS, ComponentError
from cosim.master.system import System
from cosim.trace.outcome import Cause, CauseKind


class BrokenOffError(Exception):
    """The child is gone; `cause` says why, `words` is the message."""

    def __init__(self, cause: Cause, words: str) -> None:
        super().__init__(words)
        self.cause, self.words = cause, words


class CallInProgress(NamedTuple):
    """Which FMI call the child was in, and at what time of the run.

    component, call : None between two calls.
    seconds : None before the first communication point [s].
    """

    component: str | None
    call: str | None
    seconds: float | None


def broken_off(
    system: System,
    kind: CauseKind,
    what: str,
    at: CallInProgress,
    *,
    limit: str | None,
    printed: Sequence[str],
) -> BrokenOffError:
    """Return the error of a run whose child is gone.

    `limit` : the one that was exceeded; `printed` : the last lines of its standard error.
    """
    component, call, seconds = at
    path = "" if component is None else system.components[component].description.path.name
    place = "" if call is None else f" in {call}"
    when = "before the first communication point" if seconds is None else f"at t = {seconds:g} s"
    error = ComponentError(
        f"{what}{place} {when}",
        where="the run" if component is None else f"component {component!r} ({path})",
        got=" | ".join(printed) or None,
        hint=_HINTS.get(limit or kind),
    )
    return BrokenOffError(Cause(kind, component, call, seconds, what), error.text())


_HINTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **DEATH_HINTS,
        "altered": "a fault of an FMU, which writes to memory that is not its own: a component "
        "with isolate = true cannot reach the rows of others",
        **{
            f"limits.{name}": f"a greater limits.{name}, for this run or in the "
            "scenario; none for no limit"
            for name in ("call", "run", "start", "end", "memory")
        },
    }
)
