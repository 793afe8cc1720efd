"""Run linear algebra on one thread.

Matrices of a hundred rows are slower on several threads, much slower on a busy machine; and the
last digits must not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from cosim.core import one_blas_thread

P = ParamSpec("P")
T = TypeVar("T")


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function to run NumPy and SciPy on one thread."""

    @wraps(function)
    def on_one_thread(*args: P.args, **kwargs: P.kwargs) -> T:
        with one_blas_thread():
            return function(*args, **kwargs)

    return on_one_thread
