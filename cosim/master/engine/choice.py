"""Choose the engine of a run; the result and the trace name it and the reason."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Literal, NamedTuple, Protocol

from cosim.core import InputError
from cosim.master.engine.program import EarlyStop, Program
from cosim.master.engine.python import PythonEngine

EngineName = Literal["auto", "python", "compiled"]

WORTH_COMPILING = 50_000
"""Communication points from which on loading the compiled engine (half a second) pays."""


class EngineChoice(NamedTuple):
    """The engine of a run and why it was chosen."""

    name: str
    reason: str


class Engine(Protocol):
    """Executes a program."""

    def where(self) -> tuple[int, bool]:
        """Return the point that is being executed, and whether its row is complete."""

    def advance(self, first: int, last: int) -> EarlyStop | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""

    def update_routes(self, first: int, last: int) -> None:
        """Take over the rows to be read at the points first to last - 1, which are known now."""

    def send(self, k: int) -> EarlyStop | None:
        """Execute the first half of point k: after it, the values sent are in the row."""

    def receive_and_step(self, k: int) -> EarlyStop | None:
        """Execute the second half of point k."""


def choose_engine(asked: EngineName, points: int, *, texts: bool = False) -> EngineChoice:
    """Choose the engine for a run of so many points; `texts`: it exchanges Strings.

    Raises
    ------
    InputError : the compiled engine is requested, but numba is not installed or Strings are
        exchanged.
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
    """Build the engine of this name for a program."""
    if name == "python":
        return PythonEngine(program)
    from cosim.master.engine.compiled import (  # noqa: PLC0415 - loading it takes half a second
        CompiledEngine,
    )

    return CompiledEngine(program)
