"""Make a thing once in a process, also where several threads ask for it at the same time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache, update_wrapper
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class once(Generic[T]):  # noqa: N801 - used like a function
    """Decorate a function to be called once for the same arguments; later calls get its result.

    `functools.cache` calls it in every thread that asks before the first one has the result; here
    these wait. A call that raises is made again.
    """

    def __init__(self, function: Callable[..., T]) -> None:
        self._guard = threading.RLock()
        self._kept = cache(function)
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> T:
        """Return the result for these arguments."""
        with self._guard:
            return self._kept(*arguments)

    def cache_clear(self) -> None:
        """Forget all results."""
        with self._guard:
            self._kept.cache_clear()
