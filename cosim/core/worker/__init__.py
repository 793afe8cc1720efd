"""One child process for all that runs foreign code: supervised runs, isolated slaves, checks.

    worker = Worker("package.module:function", received=Answer)
    worker.frames.send(question)          # typed, bounded; never waited for
    worker.exit_status()                  # None while it lives

Between this process and the worker stands its keeper, which loads no foreign code: it is forked
from this process where that is safe, else from a fresh interpreter, forks the worker, waits for its
end, ends whatever the worker has started, and tells the exit status. When this process is gone, the
keeper ends the worker. Memory that both processes map is sealed against shrinking; what the worker
prints is captured, up to a number of lines.
"""

from cosim.core.worker.frames import FrameError, Frames
from cosim.core.worker.memory import SharedMemory
from cosim.core.worker.output import MOST_LINES, Output
from cosim.core.worker.process import Method, Worker, default_method
from cosim.core.worker.raised import RaisedError
from cosim.core.worker.waiting import Waiting

__all__ = [
    "MOST_LINES",
    "FrameError",
    "Frames",
    "Method",
    "Output",
    "RaisedError",
    "SharedMemory",
    "Waiting",
    "Worker",
    "default_method",
]
