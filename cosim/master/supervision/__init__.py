"""Supervised runs: a child process holds the slaves and the loop, this one everything else.

    with Supervisor() as supervisor:
        conducted = supervisor.run(system, observers, conduct)

The child executes a `Session`; `conduct` says what is done with it. Rows lie in memory that both
processes map; log lines, new texts and results come over a pipe, in order; the FMI call in
progress stands in a word of the shared memory. So the parent knows component, call and time when
the child dies or exceeds a limit, and has every complete row.
"""

from cosim.master.supervision.calls import BROKEN, OVERDUE, Calls
from cosim.master.supervision.limits import Limits
from cosim.master.supervision.supervisor import Conducted, Supervisor

__all__ = ["BROKEN", "OVERDUE", "Calls", "Conducted", "Limits", "Supervisor"]
