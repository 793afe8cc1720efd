"""A worker pool of a test, as `execute_study` takes it: what is executed is seen, and stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Self


class RunByRun:
    """Executes one run after the other in this process.

    before : called with the number of each run; what it raises ends the study.

    Attributes
    ----------
    runs : numbers of the runs that were begun, in order, a repeated one for its trace included.
    works : names of what was asked of runs, each once.
    """

    size = 1

    def __init__(self, before: Callable[[int], None] | None = None) -> None:
        self.notice: Callable[[str], None] = lambda _text: None
        self.runs: list[int] = []
        self.works: list[str] = []
        self._before = before

    def __call__(self) -> Self:
        return self

    def run_batches(self, function: Any, job: Any, next_batch: Any) -> Iterator[Any]:
        """Execute every batch run by run; yield each run and its result."""
        if function.__name__ not in self.works:
            self.works.append(function.__name__)
        while (batch := next_batch()) is not None:
            for run in batch:
                self.runs.append(run)
                if self._before is not None:
                    self._before(run)
                yield [run], function(job, [run])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass
