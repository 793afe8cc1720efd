"""The engine of a run: the kernel in C, or the loop in Python; the result names it and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, Protocol, get_args

from cosim.core import InputError
from cosim.master.compiled import load_kernel
from cosim.master.event_instance import EventInstance
from cosim.master.guards import Guards
from cosim.master.kernel import KernelLoop
from cosim.master.plain_loop import PlainLoop
from cosim.master.table import EarlyStop, Table

EngineName = Literal["auto", "kernel", "python"]
"""What runs the loop: the kernel in C, the loop in Python, or whichever can."""


class EngineChoice(NamedTuple):
    """The engine of a run and why it was chosen."""

    name: str
    reason: str


class Engine(Protocol):
    """Carries out a table of operations."""

    def run(
        self, begin: int, end: int, first: int, last: int, guards: Guards | None = None
    ) -> EarlyStop | None:
        """Carry out operations begin to end - 1 at points first to last - 1.

        guards : looked at behind each point; an early stop is at the first that is not met.
        """

    def close(self) -> None:
        """End its threads."""


def choose_engine(
    asked: EngineName, *, texts: bool = False, events: bool = False, threads: int = 1
) -> EngineChoice:
    """Choose the engine of a run.

    `texts`: it exchanges Strings or Binary; `events`: its components have events; `threads`: it
    steps on so many.

    Raises
    ------
    InputError : no such engine; the kernel or several threads are asked for, and it cannot be
        compiled.
    """
    if asked not in get_args(EngineName):
        raise InputError.unknown("engine", str(asked), get_args(EngineName), where="engine")
    choice = _choice(asked, texts=texts, events=events)
    if threads > 1 and choice.name == "python":
        raise InputError(
            "components step side by side in the kernel only",
            where="run.threads",
            expected="the engine kernel",
            got=f"the engine python: {choice.reason}",
            hint="run.threads = 1",
        )
    return choice


def _choice(asked: EngineName, *, texts: bool, events: bool) -> EngineChoice:
    if asked == "python":
        return EngineChoice("python", "asked for")
    try:
        load_kernel()
    except InputError as error:
        if asked == "kernel":
            raise InputError(
                "the kernel cannot be compiled",
                where="engine",
                expected=error.expected,
                got=error.got,
                hint=f"{error.hint or 'a C compiler'}; or take the engine python",
            ) from error
        return EngineChoice("python", f"the kernel needs a C compiler: {error.got}")
    by_python = ["events"] * events + ["Strings and Binary"] * texts
    reason = f"{' and '.join(by_python)} by Python" if by_python else "numbers only"
    return EngineChoice("kernel", "asked for" if asked == "kernel" else reason)


def build_engine(name: str, table: Table, events: Mapping[int, EventInstance]) -> Engine:
    """Build the engine of this name for a table.

    events : by number of the instance; of their points the kernel has those without any alone.
    """
    return KernelLoop(table) if name == "kernel" and not events else PlainLoop(table, events)
