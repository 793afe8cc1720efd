"""Call functions in a child process: many short ones, of which one may end the process.

What is called runs unsupervised there, so that it costs a message each way. When the child dies, or
exceeds a limit, the caller knows which call it was, and nothing more: `Supervisor` finds out more.
"""

from __future__ import annotations

import math
import selectors
import time
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any, Final

from cosim.core import death_of
from cosim.fmu import own_folder
from cosim.master.supervision import messages
from cosim.master.supervision.limits import Limits
from cosim.master.supervision.output import Output
from cosim.master.supervision.process import Worker

_TICK_S: Final = 0.05


class CallBrokenError(Exception):
    """The child died in a call, or was ended since it exceeded a limit."""


class Calls:
    """Calls functions in a child that is forked at the first call, and after each death.

    Parameters
    ----------
    known : objects that the child has as they are when it is forked; arguments refer to them.
    """

    def __init__(self, known: Sequence[Any]) -> None:
        self._known = tuple(known)
        self._worker: Worker | None = None
        self._outputs: list[Output] = []
        self._numbers = count(1)

    def __call__(self, limits: Limits, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function of a module there, within `limits.run` and `limits.memory`.

        Raises
        ------
        CallBrokenError : the child has died; the next call has a new one.
        CosimError : what the function raises.
        """
        worker = self._alive()
        number = next(self._numbers)
        folder = str(own_folder())
        message = (messages.CALL, number, folder, function, arguments)
        content = messages.packed(message, worker.known)
        try:
            worker.connection.send_bytes(content)
            kind, *found = self._answer(worker, number, limits)
        except (EOFError, OSError) as error:
            status = worker.kill()
            self.close()
            raise CallBrokenError(death_of(status).words) from error
        if kind == messages.RAISED:
            parts, trace = found
            raised = messages.exception_of(parts)
            raised.add_note(trace)
            raise raised
        return found[0]

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
        """Wait for the answer to a call; what the child prints is read and forgotten.

        Raises
        ------
        EOFError, OSError : the child is gone, or was just ended.
        """
        until = math.inf if limits.run is None else time.monotonic() + limits.run
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
                elif _is_over(worker, until, None if ready else limits.memory):
                    raise EOFError


def _is_over(worker: Worker, until: float, memory: int | None) -> bool:
    """Whether the child is gone, or exceeds a limit; `memory` : None for none, or not now."""
    if worker.exit_status() is not None or time.monotonic() > until:
        return True
    used = None if memory is None else worker.memory_used()
    return memory is not None and used is not None and used > memory


def _forget(_name: str, _level: str, _line: str) -> None:
    """Nobody reads it."""
