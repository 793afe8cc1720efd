"""Supervised runs of scenarios: in a child process, by default, and within limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

from cosim.core import InputError, Method, default_method
from cosim.master import EngineName, Limits, Supervisor, System, load_kernel
from cosim.scenario.interrupt import DeferredInterrupt, InterruptedRun, TerminatedRun
from cosim.scenario.outcome import Outcome
from cosim.scenario.run_limits import LimitsPart, parse_limits
from cosim.scenario.schema import ScenarioPart


@dataclass(frozen=True)
class Supervision:
    """Whether and how a run is supervised.

    Attributes
    ----------
    limits : of the run.
    supervised : whether the components run in a child process; else in this one.
    method : how that is started; None: as is best then.
    """

    limits: Limits
    supervised: bool
    method: Method | None = None

    @contextmanager
    def open(
        self,
        first: System | None = None,
        known: Sequence[Any] = (),
        engine: EngineName = "auto",
    ) -> Iterator[Supervisor | None]:
        """Start the child process, and note Ctrl-C and SIGTERM as long as it lives.

        `first`, `known` : see `Supervisor`.
        """
        if not self.supervised:
            yield None
            return
        if engine != "python":
            # here, where standard error is the user's: a cache that cannot be written is told there
            with suppress(InputError):  # the child process finds that out again, and says so
                load_kernel()
        with (
            DeferredInterrupt() as interruption,
            Supervisor(
                self.limits,
                method=self.method,
                interruption=interruption,
                first=first,
                known=known,
            ) as supervisor,
        ):
            yield supervisor


def supervision_of(
    scenario: ScenarioPart, limits: Sequence[str] = (), *, supervise: bool | None = None
) -> Supervision:
    """Return what a scenario says of supervision and limits.

    Parameters
    ----------
    limits : more limits, which come first: "call=30", "memory=2 GB", "run=none".
    supervise : instead of `run.supervise`.

    Raises
    ------
    InputError : a limit that does not exist, or is not one.
    """
    part = scenario.limits or LimitsPart()
    given = {key: getattr(part, key) for key in part.model_fields_set}
    given |= parse_limits(limits)
    found: dict[str, Any] = {k: v or None for k, v in given.items() if v is not None}
    if found.get("memory"):
        found["memory"] = int(found["memory"])
    wanted = scenario.run.supervise if supervise is None else supervise
    return Supervision(replace(Limits(), **found), wanted and default_method() is not None)


def raise_if_interrupted(outcome: Outcome, supervisor: Supervisor | None) -> None:
    """Raise what ends the command after a signal, now that the run is on disk.

    Raises
    ------
    InterruptedRun, TerminatedRun : see there.
    """
    number = 0
    if supervisor is not None and supervisor.interruption is not None:
        number = supervisor.interruption.requested
    if number == InterruptedRun.exit_code - 128:
        raise InterruptedRun(outcome)
    if number:
        raise TerminatedRun(outcome)
