"""Keep linear algebra on one thread: a setting of the process, which threads of Python share."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from cosim.core.made_once import once

_guard: Final = threading.Lock()
_users: list[int] = []
"""The threads that are in a context now."""
_limits: dict[tuple[bool, ...], Any] = {}
"""What puts back the setting from before, by the libraries that were loaded."""
_WITH_BLAS: Final = ("numpy", "scipy.linalg")
"""Each has a BLAS of its own."""


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Run NumPy and SciPy on one thread in this context.

    Contexts of several threads overlap: the first one sets it, the last one puts it back.
    """
    with _guard:
        loaded = tuple(name in sys.modules for name in _WITH_BLAS)
        if loaded not in _limits:
            _limits[loaded] = _pools(loaded).limit(limits=1, user_api="blas")
        _users.append(threading.get_ident())
    try:
        yield
    finally:
        with _guard:
            _users.pop()
            while _limits and not _users:
                _limits.popitem()[1].restore_original_limits()


@once
def _pools(_loaded: tuple[bool, ...]) -> Any:
    from threadpoolctl import ThreadpoolController  # noqa: PLC0415 - most commands solve nothing

    return ThreadpoolController()
