"""The process of an isolated slave: a worker with memory for what is exchanged in the loop."""

from __future__ import annotations

import contextlib
import ctypes
import os
from typing import Final

from cosim.core import ComponentError, FrameError, Worker, death_of
from cosim.fmu.description import FmuDescription
from cosim.fmu.isolation.channel import (
    DATA,
    FUTEX,
    Channel,
    channel_library,
    make_channel,
    reserve,
)
from cosim.fmu.isolation.requests import Message, Ready

TICK_S: Final = 0.02
"""Between two looks at whether a process that is waited for still lives."""
_PATIENCE_S: Final = 1.0


class SlaveProcess:
    """A process for one isolated slave; `close` ends it.

    Parameters
    ----------
    component : its name, in messages.
    description : of its FMU, with the lengths of arrays that it will have.
    call_limit : of one call during the run [s of wall-clock time]; None: no limit.

    Raises
    ------
    InputError : a system on which components cannot be isolated, or no C compiler.

    Attributes
    ----------
    worker : the process, which maps the values of this slave and no others.
    """

    def __init__(
        self, component: str, description: FmuDescription, *, call_limit: float | None = None
    ) -> None:
        self.component, self.call_limit = component, call_limit
        library = channel_library()
        ports = description.ports.values()
        size = DATA + 8 + sum(4 + 8 * port.size for port in ports)
        self._memory, descriptor = reserve(size)
        self._memory.keep_from_forks()  # it is this slave's, and this process's
        self._bells, bells_there = _bells()
        try:
            self.worker = Worker(
                "cosim.fmu.isolation.server:main",
                (size, library._name),  # noqa: SLF001 - where it was loaded from
                received=Message,
                descriptors=[descriptor, *(bell for bell in bells_there if bell >= 0)],
                captured=False,
                patience_s=0.0,
            )
        finally:
            _close(descriptor, *bells_there)

    @property
    def number(self) -> int:
        """The number of the process."""
        number: int = self.worker.number
        return number

    @property
    def memory_at_start(self) -> int | None:
        """The memory that it had before it loaded anything [bytes]; None if unknown."""
        return self.worker.memory_at_start

    def wait_until_ready(self) -> None:
        """Wait until it can be asked for something.

        Raises
        ------
        ComponentError : it has ended.
        """
        with contextlib.suppress(EOFError, OSError, FrameError):
            if isinstance(self.worker.frames.receive(), Ready):
                return
        raise ComponentError(
            "the process of an isolated component did not start",
            where=f"component {self.component!r}",
            got=f"it {death_of(self.worker.wait(_PATIENCE_S)).words}",
            hint="its standard error may say why; or isolate = false",
        )

    def channel(self, look: int = 0) -> Channel:
        """Make the master's side of its channel; see `make_channel`."""
        return make_channel(self._memory, self._bells, look)

    def close(self) -> None:
        """Let it leave, or end it."""
        if self.worker.frames.closed:
            return
        self.worker.let_go()
        channel = self.channel()
        channel_library().announce_message(ctypes.addressof(channel))
        self.worker.close(_PATIENCE_S)
        _close(*self._bells)


def _bells() -> tuple[tuple[int, int], tuple[int, int]]:
    """Return own and other bell of the master and of the slave: pipes where there is no futex."""
    if FUTEX:
        return (-1, -1), (-1, -1)
    of_master, of_slave = os.pipe(), os.pipe()
    for end in (*of_master, *of_slave):
        os.set_blocking(end, False)
    return (of_master[0], of_slave[1]), (of_slave[0], of_master[1])


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        with contextlib.suppress(OSError):
            os.close(descriptor)
