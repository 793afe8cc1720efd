"""The co-simulation loop (fixed or event-aligned points; Jacobi or Gauss-Seidel).

    for every communication point t_k:
        every component sends:    its outputs go into row k
        every component receives: its inputs are read off the rows that the links name
        every component steps from t_k to its next point, inputs held

(Jacobi; under Gauss-Seidel the components take turns, and each receives what those before it have
reached at t_{k+1}.) An engine (`cosim.master.engine`) carries that out, a stretch of points at a
time; between two stretches the observers look at the rows that are there, and a run that has left
its range ends. How long a stretch is depends on the machine; nothing that is recorded depends on
it.

The coupling delays what a component computes from its inputs until the next point; that
delay is the loop's own and is reported apart from the links'.
"""

from __future__ import annotations

from collections.abc import Sequence

from cosim.master.engine import EngineName
from cosim.master.journal import Observer
from cosim.master.run import Run
from cosim.master.session import Session
from cosim.master.system import System


def simulate(
    system: System, observers: Sequence[Observer] = (), *, engine: EngineName = "auto"
) -> Run:
    """Run a system from 0 to its end, or to where it diverges or fails.

    Parameters
    ----------
    engine : "python", "compiled", or "auto": compiled where it pays (`choose`).

    Raises
    ------
    InputError, ComponentError : as `Session`.
    """
    with Session(system, observers, engine=engine) as session:
        session.run_until()
        return session.result()
