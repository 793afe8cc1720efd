"""Worker processes of this machine: each is a child process that executes batches of runs.

They are forked where that is safe, from a process that has loaded no FMU, and know the study as it
is here. Each has a child of its own for its runs, as this process has where there is one worker.
"""

from __future__ import annotations

import contextlib
import signal
import socket
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from cosim.core import FrameError, Frames, RaisedError, Waiting, Worker, default_method
from cosim.fmu import adopt_folder, own_folder
from cosim.study.batch import Job, Row, begin_worker, record_batch, run_batch
from cosim.study.workers import (
    ATTEMPTS,
    Batch,
    BatchFunction,
    InProcessPool,
    WorkerDied,
    WorkerPool,
)

_TARGET: Final = f"{__name__}:serve"
_LOOK_S: Final = 0.5
_IN_HAND: Final = 2
"""Batches that a worker has: the one that it executes, and the next."""
_LEAVE_S: Final = 2.0
"""How long a worker may take to end its own child."""


class Do(msgspec.Struct):
    """To a worker: execute these runs, or repeat them with a trace each."""

    records: bool
    runs: list[int]


class Done(msgspec.Struct, tag=True):
    """From a worker: what became of the runs, as `run_batch` or `record_batch` returns it."""

    rows: list[Row] = []
    reasons: list[str | None] = []


class Failed(msgspec.Struct, tag=True):
    """From a worker: its batch raised an exception."""

    error: RaisedError


class _Hands:
    """Which batches each worker has in hand, and how often workers have died on them.

    One waits with each while it executes another: it begins at once, whatever this process does.
    """

    def __init__(self, next_batch: Callable[[], Batch | None]) -> None:
        self._next_batch = next_batch
        self._again: deque[tuple[Batch, int]] = deque()
        self._of: defaultdict[Worker, deque[tuple[Batch, int]]] = defaultdict(deque)

    @property
    def full(self) -> list[Worker]:
        """The workers that have a batch."""
        return [worker for worker, batches in self._of.items() if batches]

    def count(self, worker: Worker) -> int:
        """Return how many batches a worker has."""
        return len(self._of[worker])

    def next_for(self, worker: Worker) -> Batch | None:
        """Give a worker the next batch, and return it; None: there is none."""
        if self._again:
            given = self._again.popleft()
        elif (batch := self._next_batch()) is not None:
            given = batch, 0
        else:
            return None
        self._of[worker].append(given)
        return given[0]

    def done(self, worker: Worker, *, died: bool) -> tuple[Batch, bool]:
        """Take the batch that a worker executed; return it, and whether it is executed again.

        A worker that died did so in the first that it had.
        """
        batch, attempt = self._of[worker].popleft()
        if not died:
            return batch, False
        self._again += self._of.pop(worker)
        if attempt + 1 < ATTEMPTS:
            self._again.append((batch, attempt + 1))
        return batch, attempt + 1 < ATTEMPTS


class LocalPool:
    """So many processes of this machine; one that dies is replaced."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.notice: Callable[[str], None] = lambda _text: None
        self.workers: list[Worker] = []
        self._job: Job | None = None

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Execute batches until `next_batch` returns None; yield each batch and its result.

        Raises
        ------
        CosimError : what the function raises; no process can be started.
        """
        if job is not self._job:
            self.close()
            self._job = job
        hands = _Hands(next_batch)
        try:
            while True:
                while (worker := self._free(job, hands)) and (batch := hands.next_for(worker)):
                    with contextlib.suppress(OSError):  # it has died, which is heard of later
                        worker.frames.send(Do(function is record_batch, batch), wait=False)
                if not hands.full:
                    return
                for worker, found in self._heard(hands):
                    batch, again = hands.done(worker, died=isinstance(found, WorkerDied))
                    if not again:
                        yield batch, found
        except BaseException:
            self.close()
            raise

    def _free(self, job: Job, hands: _Hands) -> Worker | None:
        """Return a worker for another batch, the one with the fewest; None: all have enough."""
        first = min(self.workers, key=hands.count, default=None)
        if len(self.workers) < self.size and (first is None or hands.count(first)):
            # the folder of what is unpacked is that of this process, which removes it
            first = Worker(
                *(_TARGET, (job, str(own_folder()))),
                received=Done | Failed,
                captured=False,
                loaded=True,
            )
            self.workers.append(first)
        return first if first is not None and hands.count(first) < _IN_HAND else None

    def _heard(self, hands: _Hands) -> Iterator[tuple[Worker, list[Any] | WorkerDied]]:
        """Wait for a while; yield what workers have done by then, and which have died."""
        with Waiting(hands.full) as waiting:
            waiting.wait(_LOOK_S)
        for worker in hands.full:
            while hands.count(worker) and (found := self._result(worker)) is not None:
                yield worker, found

    def _result(self, worker: Worker) -> list[Any] | WorkerDied | None:
        """Return what a worker has done; that it died; None: nothing yet."""
        message = None
        try:
            worker.frames.flush()
            message = worker.frames.take()
        except FrameError:  # an FMU that runs in it wrote to its connection
            worker.kill()
        except (EOFError, OSError):
            pass
        if isinstance(message, Done):
            return message.rows or message.reasons
        if isinstance(message, Failed):
            raise message.error.error()
        if worker.exit_status() is None:
            return None
        self.workers.remove(worker)
        worker.close(0.0)
        return WorkerDied(ATTEMPTS)

    def close(self) -> None:
        """End the workers."""
        for worker in self.workers:
            worker.let_go()
        for worker in self.workers:
            worker.close(_LEAVE_S)
        self.workers.clear()


@contextlib.contextmanager
def local(workers: int) -> Iterator[WorkerPool]:
    """Open a pool of so many processes of this machine, or of this one where there are none."""
    if default_method() is None:
        yield InProcessPool()
        return
    with contextlib.closing(LocalPool(workers)) as pool:
        yield pool


def serve(end: socket.socket, _given: Sequence[int], job: Job, folder: str) -> None:
    """Be a worker: execute batches until nobody listens any more."""
    # the terminal sends Ctrl-C to all processes; the one that started the study ends the others
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    begin_worker(job)
    adopt_folder(Path(folder))
    with contextlib.closing(Frames(end, Do)) as frames, contextlib.suppress(EOFError, OSError):
        while True:
            asked: Do = frames.receive()
            frames.send(_answer(job, asked))


def _answer(job: Job, asked: Do) -> Done | Failed:
    try:
        if asked.records:
            return Done(reasons=record_batch(job, asked.runs))
        return Done(rows=run_batch(job, asked.runs))
    except Exception as error:  # noqa: BLE001 - raised where the study is
        return Failed(RaisedError.of(error))
