"""Worker pools: this process, or a Dask cluster (`local_workers`: processes of this machine).

A pool takes batches while there are any and yields their results in the order of completion. The
results do not depend on the pool.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cosim.core import ComponentError, CosimError, InputError
from cosim.study.batch import Job
from cosim.study.folder import not_kept
from cosim.study.shipping import Offer, keep_traces, run_ticket

Batch = list[int]
BatchFunction = Callable[[Job, Batch], list[Any]]
"""Executed in a worker: `run_batch` or `record_batch`."""

ATTEMPTS = 2
"""A batch is given back after so many workers died on it."""
# batches submitted per worker, so that none waits for the next; an adaptive cluster grows only if
# there is more work than for `distributed.adaptive.target-duration`, 5 s, which is not two batches
_AHEAD = 4
_CONNECT_S = 5
WAIT_S = 600.0
"""How long to wait for workers by default, when there are none [s]: far longer than one starts."""
_PIECE_S = 0.1  # of a batch in this process, after which its rows are kept
_SAY_S = 30.0  # without workers, before it is reported
_LOOK_S = 1.0
_POLL_S = 0.02
_INSTALL = "pip install 'auv-cosim[study]'"


@dataclass(frozen=True)
class WorkerDied:
    """Takes the place of rows if each process that executed the batch died."""

    attempts: int


class WorkerPool(Protocol):
    """What every worker pool offers.

    size : number of workers.
    notice : told what the user should know while batches are executed.
    """

    size: int
    notice: Callable[[str], None]

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Execute batches until `next_batch` returns None; yield each batch and its result."""


class InProcessPool:
    """Executes all runs in this process, one after the other."""

    size = 1

    def __init__(self) -> None:
        self.notice: Callable[[str], None] = _unheard

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Execute batches until `next_batch` returns None; yield each batch and its result."""
        size = 1
        while (batch := next_batch()) is not None:
            while batch:
                piece, batch = batch[:size], batch[size:]
                began = time.perf_counter()
                result = function(job, piece)
                each = (time.perf_counter() - began) / len(piece)
                # an interruption loses no more than the current piece
                size = max(1, int(_PIECE_S / max(each, 1e-6)))
                yield piece, result


class DaskPool:
    """The workers of a Dask client, which may share no folder with this process.

    wait_s : how long to wait for workers when there are none [s]; None: for ever.
    """

    def __init__(self, client: Any, wait_s: float | None) -> None:
        self._client, self._wait_s = client, wait_s
        self._offer = Offer(client)
        self.notice: Callable[[str], None] = _unheard
        self.size = max(1, self._workers())

    def _workers(self) -> int:
        """Return how many workers there are; none that answer if the scheduler does not."""
        try:
            return len(self._client.scheduler_info(n_workers=-1)["workers"])
        except (OSError, TimeoutError):
            return 0

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Execute batches until `next_batch` returns None; yield each batch and its result.

        Raises
        ------
        ComponentError : no workers for too long, or the scheduler is gone.
        """
        import distributed  # noqa: PLC0415 - optional: the extra `study`

        in_hand: dict[str, tuple[Any, Batch]] = {}
        done: Any = distributed.as_completed()
        number = itertools.count()
        mark = os.urandom(4).hex()
        ticket = self._offer.ticket(job)

        def fill() -> None:
            # a cluster may grow or shrink during a study
            while len(in_hand) < _AHEAD * self.size and (batch := next_batch()) is not None:
                key = f"{job.study.title[:20]}-{mark}-{next(number)}"
                future = self._client.submit(
                    run_ticket, function, ticket, batch, key=key, pure=False
                )
                in_hand[key] = future, batch
                done.add(future)

        try:
            fill()
            for future in self._completed(done):
                _, batch = in_hand.pop(future.key)
                found = _result(future)
                future.release()
                if isinstance(found, WorkerDied):
                    yield batch, found
                else:
                    rows, traces = found
                    with not_kept(Path(ticket.traces or "")):
                        keep_traces(ticket, traces)
                    yield batch, rows
                fill()
        finally:
            left = [future for future, _ in in_hand.values()]
            if left:
                with contextlib.suppress(Exception):
                    self._client.cancel(left, force=True)

    def close(self) -> None:
        """Withdraw what workers may ask for."""
        self._offer.close()

    def _completed(self, done: Any) -> Iterator[Any]:
        """Yield futures as they are completed; look from time to time whether there are workers."""
        looked = since = time.monotonic()
        reported = 0.0
        if not self._workers():
            address = self._client.scheduler.address
            self.notice(f"no workers yet; one by hand: dask worker {address} --nthreads 1")
        while not done.is_empty():
            found = done.next_batch(block=False)
            yield from found
            now = time.monotonic()
            if now - looked >= _LOOK_S:
                looked, count = now, self._workers()
                self.size = max(1, count)
                since, reported = (since, reported) if not count else (now, 0.0)
            alone = looked - since
            if self._wait_s is not None and alone > self._wait_s:
                raise ComponentError(
                    f"no workers for {alone:.0f} s",
                    where="workers",
                    expected="workers that stay, or new ones in their place",
                    hint="finished runs are kept: the same command continues; "
                    "`wait_for_workers` none waits for ever",
                )
            if alone > reported + _SAY_S:
                reported = alone
                self.notice(f"no workers for {alone:.0f} s")
            if not found:
                time.sleep(_POLL_S)


def _unheard(_text: str) -> None:
    """Nobody listens."""


def _result(future: Any) -> tuple[list[Any], dict[str, bytes]] | WorkerDied:
    from distributed import KilledWorker  # noqa: PLC0415 - optional

    try:
        found: tuple[list[Any], dict[str, bytes]] = future.result()
    except KilledWorker:
        return WorkerDied(ATTEMPTS)
    except CosimError:  # such as other versions there
        raise
    except CancelledError as error:
        raise ComponentError(
            "the scheduler does not answer any more",
            where="workers",
            expected="a scheduler that keeps running",
            hint="finished runs are kept: the same command continues",
        ) from error
    except Exception as error:
        raise ComponentError(
            "a batch of runs cannot be executed on the cluster",
            where="workers",
            expected="workers with the same auv-cosim",
            got=f"{type(error).__name__}: {error}"[:400],
            hint="finished runs are kept: the same command continues",
        ) from error
    return found


@contextlib.contextmanager
def in_process() -> Iterator[WorkerPool]:
    """Open a pool of this process alone."""
    yield InProcessPool()


@contextlib.contextmanager
def cluster(address: str, wait_s: float | None = WAIT_S) -> Iterator[WorkerPool]:
    """Open a pool of the workers of a Dask scheduler, `tcp://HOST:PORT`.

    It needs no workers yet: an adaptive cluster starts them when there is work.

    `wait_s` : how long to wait for workers when there are none [s]; None: for ever.

    Raises
    ------
    InputError : Dask is not installed; no scheduler answers there.
    """
    _, distributed = _dask()
    with _silent():
        try:
            client = distributed.Client(address, timeout=f"{_CONNECT_S}s", name="study")
        except Exception as error:  # of many types, all of which mean that nobody answers
            raise InputError(
                "no scheduler answers",
                where=f"`scheduler` {address}",
                expected="the address of a Dask scheduler, as in tcp://127.0.0.1:8786",
                got=f"{type(error).__name__}: {error}"[:300],
                hint="start one with dask scheduler, and workers with dask worker ADDRESS",
            ) from error
        with client, contextlib.closing(DaskPool(client, wait_s)) as pool:
            yield pool


def _dask() -> tuple[Any, Any]:
    try:
        import dask  # noqa: PLC0415 - optional: the extra `study`
        import distributed  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            "studies on a cluster need Dask",
            where="workers",
            got=str(error),
            hint=f"{_INSTALL}; `workers` of this machine need none",
        ) from error
    return dask, distributed


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Silence Dask's loggers and warnings: a study reports these events itself."""
    # Dask gives some of its loggers levels of their own
    known = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    loggers = [logging.getLogger(name) for name in {"distributed", "distributed.client", *known}]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"(distributed|tornado|asyncio|contextlib)")
            yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
