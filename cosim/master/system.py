"""What the master runs: a closed description, checked."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.master.checks import check_links, check_parts
from cosim.master.parts import (
    Algorithm,
    Component,
    Connection,
    DelaySource,
    Endpoint,
    LogLevel,
    Parts,
    Policy,
    Signal,
)

__all__ = [
    "Algorithm",
    "Component",
    "Connection",
    "DelaySource",
    "Endpoint",
    "LogLevel",
    "Policy",
    "Signal",
    "System",
]


@dataclass(frozen=True)
class System(Parts):
    """A closed description of one run.

    Attributes
    ----------
    components : by name, in the order in which they are stepped.
    connections : one per input at most; a source may be the state of a packet link.
    links : by name.
    driven : inputs that follow a given signal. Where points come about in the run (a link
        with a `DelaySignal`, events = "align"), it is to be a function.
    delays : by link with a `DelaySignal`, what decides its delay.
    step_ns, end_ns : communication step and end [ns].
    events : "align": sends and arrivals become communication points; "grid": they are moved
        to the next point of the grid.
    divergence : a magnitude of any output from which on the run counts as diverged.
    algorithm : "jacobi": all step from the same point on what was exchanged there;
        "gauss-seidel": one after the other, each on what those before it have reached.
    order : in which components step under Gauss-Seidel, all of them; None: senders before
        those whose outputs follow them at once, else as in `components`.
    """

    def __post_init__(self) -> None:
        check_links(self)
        check_parts(self)
