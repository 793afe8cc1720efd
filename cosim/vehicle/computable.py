"""Numbers of a vehicle with which nothing can be computed: named, not raised as NumPy does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from cosim.core import CosimError, InputError


@contextmanager
def computable(where: str) -> Iterator[None]:
    """Name the numbers of a vehicle file in place of what overflows within.

    Raises
    ------
    InputError : arithmetic or linear algebra failed.
    """
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused, or reaches a check
            yield
    except CosimError:
        raise
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        raise _beyond(where, str(error)) from error


def finite(values: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """Return values that LAPACK may see; it prints about others.

    Raises
    ------
    InputError : one of them is not finite.
    """
    if not np.isfinite(values).all():
        raise _beyond(where, "a value that is not finite")
    return values


def _beyond(where: str, got: str) -> InputError:
    return InputError(
        "the numbers of this vehicle are beyond what can be computed with",
        where=where,
        expected="numbers of a vehicle, in SI units",
        got=got,
        hint="look for one that is far too large or too small",
    )
