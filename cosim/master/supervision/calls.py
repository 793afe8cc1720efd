"""Call a function for many things in a child process, one of which may end the process.

What is called runs unsupervised there, and results come back many in a message, so that a call
costs microseconds. When the child dies, or exceeds a limit, the caller knows which call it was, and
nothing more: `Supervisor` finds out more.
"""

from __future__ import annotations

import math
import mmap
import selectors
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any, Final

import numpy as np

from cosim.fmu import own_folder
from cosim.master.supervision import messages
from cosim.master.supervision.limits import Limits
from cosim.master.supervision.output import Output
from cosim.master.supervision.process import Worker

_TICK_S: Final = 0.05
BROKEN: Final = object()
"""In place of a result: the child died in this call, or was ended since it took too much memory."""
OVERDUE: Final = object()
"""In place of a result: the child was ended since this call took too long."""


class Calls:
    """Calls functions in a child that is forked at the first call, and after each death.

    Parameters
    ----------
    known : objects that the child has as they are when it is forked; arguments refer to them.
    """

    def __init__(self, known: Sequence[Any]) -> None:
        # number of the call in progress, and when it began, which the child writes
        self._progress = np.frombuffer(mmap.mmap(-1, mmap.PAGESIZE), np.float64)[:2]
        self._known = (*known, self._progress)
        self._worker: Worker | None = None
        self._outputs: list[Output] = []
        self._numbers = count(1)

    def __call__(
        self,
        limits: Limits,
        function: Callable[..., Any],
        *arguments: Any,
        each: Sequence[Any],
    ) -> Iterator[Any]:
        """Call a function of a module there for each of some things, its last argument.

        Yield each result in order, `BROKEN` or `OVERDUE`; `limits.run` and `limits.memory` are of
        one call.

        Raises
        ------
        CosimError : what the function raises.
        """
        left = list(each)
        while left:
            done = 0
            message = (function, arguments, left)
            try:
                for results in self._results(message, limits):
                    done += len(results)
                    yield from results
            except (EOFError, OSError) as error:
                if self._worker is not None:
                    self._worker.kill()
                self.close()
                # what it had not sent yet is done again, in another child
                broken = int(self._progress[0])
                yield from self(limits, function, *arguments, each=left[done:broken])
                yield OVERDUE if isinstance(error, TimeoutError) else BROKEN
                done = broken + 1
            left = left[done:]

    def _results(self, message: tuple[Any, ...], limits: Limits) -> Iterator[list[Any]]:
        """Send calls to the child; yield their results, many at a time.

        Raises
        ------
        EOFError, OSError : the child is gone, or was just ended.
        """
        worker = self._alive()
        number, left = next(self._numbers), len(message[-1])
        self._progress[:] = 0.0, time.monotonic()
        content = (messages.CALL, number, str(own_folder()), self._progress, *message)
        worker.connection.send_bytes(messages.packed(content, worker.known))
        while left:
            kind, *found = self._answer(worker, number, limits)
            if kind == messages.RAISED:
                parts, trace = found
                raised = messages.exception_of(parts)
                raised.add_note(trace)
                raise raised
            left -= len(found[0])
            yield found[0]

    def close(self) -> None:
        """End the child."""
        if self._worker is not None:
            self._worker.close(0.0)
        self._worker = None

    def _alive(self) -> Worker:
        if self._worker is None:
            self._worker = worker = Worker("fork", self._known)
            self._outputs = [Output(d, "", "") for d in (worker.stdout, worker.stderr)]
        return self._worker

    def _answer(self, worker: Worker, number: int, limits: Limits) -> tuple[Any, ...]:
        """Wait for the next results; what the child prints is read and forgotten.

        Raises
        ------
        EOFError, OSError : the child is gone, or was just ended.
        """
        longest = math.inf if limits.run is None else limits.run
        with selectors.DefaultSelector() as selector:
            selector.register(worker.connection, selectors.EVENT_READ)
            for output in self._outputs:
                selector.register(output.descriptor, selectors.EVENT_READ)
            while True:
                ready = selector.select(_TICK_S)
                for output in [*self._outputs]:
                    output.read(_forget)
                    if output.ended:
                        selector.unregister(output.descriptor)
                        self._outputs.remove(output)
                if worker.connection.poll():
                    answered, *content = messages.unpacked(worker.connection.recv_bytes())
                    if answered == number:
                        return tuple(content)
                elif self._is_over(worker, longest, None if ready else limits.memory):
                    raise EOFError

    def _is_over(self, worker: Worker, longest: float, memory: int | None) -> bool:
        """Whether the child is gone, or takes more than `memory`; None: no limit, or not now.

        Raises
        ------
        TimeoutError : the call takes longer than `longest`.
        """
        if worker.exit_status() is not None:
            return True
        if time.monotonic() - self._progress[1] > longest:
            raise TimeoutError
        used = None if memory is None else worker.memory_used()
        return memory is not None and used is not None and used > memory


def _forget(_name: str, _level: str, _line: str) -> None:
    """Nobody reads it."""
