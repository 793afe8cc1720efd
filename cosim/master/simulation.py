"""A system from its start to its end."""

from __future__ import annotations

from collections.abc import Sequence

from cosim.master.engine import EngineName
from cosim.master.observers import Observer
from cosim.master.run import Run
from cosim.master.session import Session
from cosim.master.system import System


def simulate(
    system: System, observers: Sequence[Observer] = (), *, engine: EngineName = "auto"
) -> Run:
    """Run a system from 0 to its end, or to where it diverges or fails.

    Parameters
    ----------
    engine : "python", "compiled", or "auto": compiled where it pays (`choose_engine`).

    Raises
    ------
    InputError, ComponentError : as `Session`.
    """
    with Session(system, observers, engine=engine) as session:
        session.run_until()
        return session.result()
