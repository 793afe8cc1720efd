"""Wait for workers: until one sends a message, prints something, or ends."""

from __future__ import annotations

import selectors
from collections.abc import Callable, Iterable
from typing import Self

from cosim.core.worker.output import Output
from cosim.core.worker.process import Worker


class Waiting:
    """Waits for some workers, a context manager; reads what they print, which fills a pipe.

    Parameters
    ----------
    outputs : of these workers, as far as they are captured.
    log : takes each line, as `Output.read`; None: nobody reads them.
    """

    def __init__(
        self,
        workers: Iterable[Worker],
        outputs: Iterable[Output] = (),
        log: Callable[[str, str, str], None] | None = None,
    ) -> None:
        self._log = log or _forget
        self._outputs = [output for output in outputs if not output.ended]
        self._selector = selectors.DefaultSelector()
        for worker in workers:
            for source in worker.watched():
                self._selector.register(source, selectors.EVENT_READ)
        for output in self._outputs:
            self._selector.register(output.descriptor, selectors.EVENT_READ)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._selector.close()

    def wait(self, longest_s: float) -> bool:
        """Wait until something is there, or for so long; return whether something is."""
        ready = self._selector.select(longest_s)
        for output in [*self._outputs]:
            output.read(self._log)
            if output.ended:
                self._selector.unregister(output.descriptor)
                self._outputs.remove(output)
        return bool(ready)


def _forget(_name: str, _level: str, _line: str) -> None:
    """Nobody reads it."""
