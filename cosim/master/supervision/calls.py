"""Call a function for many things in a child process, one of which may end the process.

What is called runs unsupervised there, and results come back many in a message, so that a call
costs microseconds. When the child dies, or exceeds a limit, the caller knows which call it was, and
nothing more: `Supervisor` finds out more.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any, Final

import msgspec
import numpy as np

from cosim.core import FrameError, Output, SharedMemory, Waiting, Worker
from cosim.fmu import own_folder
from cosim.master.supervision import messages
from cosim.master.supervision.limits import Limits
from cosim.master.supervision.messages import Call, Called, Message, Raised
from cosim.master.supervision.supervisor import CHILD

_TICK_S: Final = 0.05
_PAGE: Final = 4096
BROKEN: Final = object()
"""In place of a result: the child died in this call, or was ended since it took too much memory."""
OVERDUE: Final = object()
"""In place of a result: the child was ended since this call took too long."""


class Calls:
    """Calls functions in a child that is forked at the first call, and after each death.

    Parameters
    ----------
    known : objects that the child has as they are when it starts; arguments refer to them.
    """

    def __init__(self, known: Sequence[Any]) -> None:
        # number of the call in progress, and when it began, which the child writes
        self._memory, self._descriptor = SharedMemory.reserve("cosim-calls", _PAGE)
        self._progress = np.frombuffer(self._memory.mapping, np.float64)[:2]
        self._known = known
        self._worker: Worker | None = None
        self._outputs: list[Output] = []
        self._numbers = count(1)

    def __call__(
        self,
        limits: Limits,
        function: Callable[..., Any],
        *arguments: Any,
        each: Sequence[Any],
        result: Any,
    ) -> Iterator[Any]:
        """Call a function of a module there for each of some things, its last argument.

        Yield each result in order, as this type, `BROKEN` or `OVERDUE`; `limits.run` and
        `limits.memory` are of one call.

        Raises
        ------
        CosimError : what the function raises.
        """
        left = list(each)
        while left:
            done = 0
            try:
                for results in self._results(limits, function, arguments, left, result):
                    done += len(results)
                    yield from results
            except (EOFError, OSError) as error:
                if self._worker is not None:
                    self._worker.kill()
                self._end_worker()
                # what it had not sent yet is done again, in another child
                broken = min(max(int(np.nan_to_num(self._progress[0])), done), len(left) - 1)
                yield from self(limits, function, *arguments, each=left[done:broken], result=result)
                yield OVERDUE if isinstance(error, TimeoutError) else BROKEN
                done = broken + 1
            left = left[done:]

    def _results(
        self,
        limits: Limits,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        each: Sequence[Any],
        result: Any,
    ) -> Iterator[list[Any]]:
        """Send calls to the child; yield their results, many at a time.

        Raises
        ------
        EOFError, OSError : the child is gone, or was just ended.
        """
        worker = self._alive()
        number, left = next(self._numbers), len(each)
        self._progress[:] = 0.0, time.monotonic()
        call = Call(number, str(own_folder()), function, arguments, each)
        worker.frames.send(messages.packed(call, worker.known), wait=False)
        while left:
            answer = self._answer(worker, number, limits)
            if isinstance(answer, Raised):
                raise answer.error.error()
            try:
                found = msgspec.convert(answer.results, list[result])
            except msgspec.ValidationError as error:  # it is none of the function
                raise EOFError from error
            left -= len(found)
            yield found

    def close(self) -> None:
        """End the child; no call follows."""
        self._end_worker()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.close(0.0)
        self._worker = None

    def _alive(self) -> Worker:
        if self._worker is None:
            self._worker = worker = Worker(
                CHILD,
                received=Message,
                descriptors=[self._descriptor],
                known=self._known,
                method="fork",  # also beside the threads of Dask: what is known cannot be sent
            )
            self._outputs = [Output(d, "", "") for d in (worker.stdout, worker.stderr)]
        return self._worker

    def _answer(self, worker: Worker, number: int, limits: Limits) -> Raised | Called:
        """Wait for the next results; what the child prints is read and forgotten.

        Raises
        ------
        EOFError, OSError : the child is gone, or was just ended.
        """
        longest = math.inf if limits.run is None else limits.run
        with Waiting([worker], self._outputs) as waiting:
            while True:
                ready = waiting.wait(_TICK_S)
                try:
                    worker.frames.flush()
                    message = worker.frames.take()
                    if isinstance(message, Called | Raised) and message.run == number:
                        return message
                except FrameError as error:
                    raise EOFError from error
                if message is None and self._is_over(
                    worker, longest, None if ready else limits.memory
                ):
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
