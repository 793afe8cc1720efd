"""Who flies the batches: this process, processes of this machine, or a Dask cluster.

Each takes batches as long as there are any and gives back what came of them, in the order in
which they are done; nothing in a row depends on who flew it.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from cosim.core import ComponentError, InputError
from cosim.study.batch import Job

Batch = list[int]
BatchFunction = Callable[[Job, Batch], list[Any]]
"""Done in a worker: `run_batch`, or `record_batch`."""

_ATTEMPTS = 2  # deaths of a worker under a batch, after which it is given back
_AHEAD = 2  # batches in hand per worker: the next is there when one is done
_PATIENCE_S = 20
_NO_WORKER = "10 minutes"  # far longer than a worker takes to start: none will come any more
_LOOK_S = 1.0
_INSTALL = "pip install 'auv-cosim[study]'"


@dataclass(frozen=True)
class WorkerDied:
    """In place of rows: the processes that flew the batch died, again and again."""

    attempts: int


class WorkerPool(Protocol):
    """Workers of whatever kind."""

    size: int

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Do what `next_batch` gives until it gives None."""


class InProcessPool:
    """The own process, one run after the other."""

    size = 1

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Do what `next_batch` gives until it gives None."""
        while (batch := next_batch()) is not None:
            # run by run: an interruption costs the one that is under way
            for run in batch:
                yield [run], function(job, [run])


class DaskPool:
    """The workers of a Dask client."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self.size = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))

    def run_batches(
        self, function: BatchFunction, job: Job, next_batch: Callable[[], Batch | None]
    ) -> Iterator[tuple[Batch, list[Any] | WorkerDied]]:
        """Do what `next_batch` gives until it gives None."""
        import distributed  # noqa: PLC0415 - optional: the extra `study`

        in_hand: dict[str, tuple[Any, Batch]] = {}
        done: Any = distributed.as_completed()
        number = itertools.count()
        mark = os.urandom(4).hex()

        def fill() -> None:
            # a cluster may grow or shrink while a study goes
            while len(in_hand) < _AHEAD * self.size and (batch := next_batch()) is not None:
                key = f"{job.study.title[:20]}-{mark}-{next(number)}"
                future = self._client.submit(function, job, batch, key=key, pure=False)
                in_hand[key] = future, batch
                done.add(future)

        try:
            fill()
            for future in done:
                _, batch = in_hand.pop(future.key)
                result = _result(future)
                future.release()
                self.size = max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
                yield batch, result
                fill()
        finally:
            left = [future for future, _ in in_hand.values()]
            if left:
                with contextlib.suppress(Exception):
                    self._client.cancel(left, force=True)


def _result(future: Any) -> list[Any] | WorkerDied:
    from distributed import KilledWorker  # noqa: PLC0415 - optional

    try:
        rows: list[Any] = future.result()
    except KilledWorker:
        return WorkerDied(_ATTEMPTS)
    except Exception as error:
        raise ComponentError(
            "a batch of runs cannot be carried out on the cluster",
            where="workers",
            expected="workers with the same auv-cosim, and a scheduler that stays",
            got=f"{type(error).__name__}: {error}"[:400],
            hint="what is done is kept: the same command goes on",
        ) from error
    return rows


@contextlib.contextmanager
def in_process() -> Iterator[WorkerPool]:
    """The own process alone."""
    yield InProcessPool()


@contextlib.contextmanager
def local(workers: int) -> Iterator[WorkerPool]:
    """So many processes of this machine; one that dies is replaced.

    Raises
    ------
    InputError : Dask is not installed.
    """
    dask, distributed = _dask()
    settings = {
        "distributed.scheduler.allowed-failures": _ATTEMPTS - 1,
        # so long after each death Dask looks once, and gives up a worker that is about to start
        # again just then, for good; which ones are lost is seen by `_replace_lost`
        "distributed.deploy.lost-worker-timeout": "10000 days",
        # tasks that nobody is there for become errors: a study ends, and can be taken up again
        "distributed.scheduler.no-workers-timeout": _NO_WORKER,
        "distributed.worker.preload": ["cosim.study.worker_preload"],
        # it keeps an hour of samples of every thread's stack: memory that only grows
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.limit": "1h",
    }
    with (
        dask.config.set(settings),
        _silent(),
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        cluster.loop.add_callback(_watch, cluster, workers)
        yield DaskPool(client)


def _watch(cluster: Any, workers: int) -> None:
    """Replace lost workers for as long as the cluster is there; on its event loop."""
    status = cluster.status.name
    if status == "running":
        _replace_lost(cluster, workers)
    if status not in ("closing", "closed", "failed"):
        cluster.loop.call_later(_LOOK_S, _watch, cluster, workers)


def _replace_lost(cluster: Any, workers: int) -> None:
    """Start anew the workers whose nanny, which starts them again, has given up itself."""
    lost = [n for n, nanny in cluster.workers.items() if nanny.status.name in ("closed", "failed")]
    for name in lost:
        del cluster.workers[name]
    if lost:
        cluster.scale(workers)


@contextlib.contextmanager
def cluster(address: str) -> Iterator[WorkerPool]:
    """The workers of the scheduler at an address, `tcp://HOST:PORT`.

    Raises
    ------
    InputError : Dask is not installed; no scheduler answers there, or it has no workers.
    """
    _, distributed = _dask()
    with _silent():
        try:
            client = distributed.Client(address, timeout=f"{_PATIENCE_S // 4}s", name="study")
        except Exception as error:  # many kinds, each of which means that nobody answers
            raise InputError(
                "no scheduler answers",
                where=f"--scheduler {address}",
                expected="the address of a Dask scheduler, as in tcp://127.0.0.1:8786",
                got=f"{type(error).__name__}: {error}"[:300],
                hint="start one: dask scheduler, and dask worker with its address",
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=_PATIENCE_S)
            except TimeoutError as error:
                raise InputError(
                    "the scheduler has no workers",
                    where=f"--scheduler {address}",
                    expected=f"a worker within {_PATIENCE_S} s",
                    hint=f"dask worker {address} --nthreads 1",
                ) from error
            yield DaskPool(client)


def _dask() -> tuple[Any, Any]:
    try:
        import dask  # noqa: PLC0415 - optional: the extra `study`
        import distributed  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            "studies on several processes need Dask",
            where="workers",
            got=str(error),
            hint=f"{_INSTALL}, or take one worker",
        ) from error
    return dask, distributed


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Dask says on its loggers what a study says in its own words."""
    logger = logging.getLogger("distributed")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"(distributed|tornado|asyncio|contextlib)")
            yield
    finally:
        logger.setLevel(before)
