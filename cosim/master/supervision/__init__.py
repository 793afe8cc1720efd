"""Supervised runs: a child process holds the slaves and the loop, this one everything else.

    with Supervisor() as supervisor:
        conducted = supervisor.run(system, observers, conduct)

The child is a `cosim.core.Worker`. It executes a `Session`; `conduct` says what is done with it, or
a session that is open there does what it is asked for. Rows lie in memory that both processes map;
log lines, new texts and results come as messages, in order; the FMI call in progress stands in a
word of the shared memory. So the parent knows component, call and time when the child dies or
exceeds a limit, and has every complete row: whether these are what they were when they became
complete, a checksum tells.
"""

from cosim.master.supervision.broken_off import BrokenOffError
from cosim.master.supervision.calls import BROKEN, OVERDUE, Calls
from cosim.master.supervision.followed_session import AskedError, FollowedSession
from cosim.master.supervision.limits import Limits
from cosim.master.supervision.messages import SessionState
from cosim.master.supervision.supervisor import Conducted, Supervisor

__all__ = [
    "BROKEN",
    "OVERDUE",
    "AskedError",
    "BrokenOffError",
    "Calls",
    "Conducted",
    "FollowedSession",
    "Limits",
    "SessionState",
    "Supervisor",
]
