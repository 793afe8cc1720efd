"""Run scenarios beside other tasks of asyncio."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from typing import Any

from cosim.core import AnyPath, Progress, StoppedError
from cosim.scenario.in_python import Scenario
from cosim.scenario.python_api import run
from cosim.scenario.run_result import RunResult
from cosim.scenario.schema import ScenarioPart


async def run_async(
    scenario: AnyPath | Scenario | ScenarioPart,
    trace: AnyPath | None = None,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> RunResult:
    """Run a scenario as `run` does, in a thread, so that other tasks, and other runs, can go on.

        >>> import asyncio
        >>> from cosim import DelaySystem, Scenario, run_async
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> async def several():
        ...     return await asyncio.gather(*(run_async(tank.set("run.seed", k)) for k in (1, 2)))
        >>> [result.status for result in asyncio.run(several())]
        ['finished', 'finished']

    Cancelling the task ends the run: its components are ended, and the trace keeps all rows so far.

    options : as of `run`.

    Raises
    ------
    As `run`, and asyncio.CancelledError.
    """
    cancelled = threading.Event()

    def look(phase: str, share: float) -> None:
        if cancelled.is_set():
            raise StoppedError("the run was cancelled", where=phase, got=f"{share:.0%} done")
        if progress is not None:
            progress(phase, share)

    flight = asyncio.ensure_future(
        asyncio.to_thread(run, scenario, trace, progress=look, **options)
    )
    try:
        return await asyncio.shield(flight)
    except asyncio.CancelledError:
        cancelled.set()
        with suppress(StoppedError):
            await flight
        raise
