"""Which engine a run gets, and why: said in the result and in the trace."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Literal, NamedTuple, Protocol

from cosim.core import InputError
from cosim.master.engine.program import EarlyStop, Program
from cosim.master.engine.python import PythonEngine

EngineName = Literal["auto", "python", "compiled"]

WORTH_COMPILING = 50_000
"""Communication points from which on half a second of loading is earned back."""


class EngineChoice(NamedTuple):
    """The engine of a run and why it is that one."""

    name: str
    reason: str


class Engine(Protocol):
    """Carries a program out."""

    def where(self) -> tuple[int, bool]:
        """The point that is being worked on, and whether its row is complete."""

    def advance(self, first: int, last: int) -> EarlyStop | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""

    def update_routes(self, first: int, last: int) -> None:
        """The rows to be read at the points first to last - 1 are known now."""

    def send(self, k: int) -> EarlyStop | None:
        """The first half of what happens at point k: after it, what is sent is in the row."""

    def receive_and_step(self, k: int) -> EarlyStop | None:
        """The other half."""


def choose_engine(asked: EngineName, points: int, *, texts: bool = False) -> EngineChoice:
    """The engine for a run of so many points; `texts`: it exchanges Strings.

    Raises
    ------
    InputError : the compiled engine is asked for, and numba is not installed, or there are
        Strings to be exchanged.
    """
    if texts and asked == "compiled":
        raise InputError(
            "the compiled engine exchanges numbers only",
            where="engine",
            expected="no outputs or connected inputs of type String",
            hint="take the engine python, or auto",
        )
    if texts and asked == "auto":
        return EngineChoice("python", "Strings are exchanged")
    if asked == "python":
        return EngineChoice("python", "asked for")
    compiled = find_spec("numba") is not None
    if asked == "compiled":
        if not compiled:
            raise InputError(
                "the compiled engine needs numba",
                where="engine",
                hint="pip install 'auv-cosim[fast]', or take the engine python",
            )
        return EngineChoice("compiled", "asked for")
    if not compiled:
        return EngineChoice("python", "numba is not installed (extra: fast)")
    if points < WORTH_COMPILING:
        return EngineChoice(
            "python", f"{points} points are too few to earn back the loading of a compiled engine"
        )
    return EngineChoice("compiled", f"{points} points")


def build_engine(name: str, program: Program) -> Engine:
    """The engine of that name."""
    if name == "python":
        return PythonEngine(program)
    from cosim.master.engine.compiled import (  # noqa: PLC0415 - loading it takes half a second
        CompiledEngine,
    )

    return CompiledEngine(program)
