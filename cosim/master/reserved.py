"""Arrays that are as long as a run, of which only a part is in memory.

They are reserved for the whole run as addresses. Memory comes with what is written, and goes when
it is given back: so an entry has one index for the whole run, wherever the run is.
"""

from __future__ import annotations

import mmap
from math import prod
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from cosim.core import InputError

_SMALL: Final = 1 << 20
"""Arrays up to this size [bytes] are ordinary ones: nothing of them is given back."""
_NO_RESERVE: Final = getattr(mmap, "MAP_NORESERVE", 0x4000)
_FORGET: Final = getattr(mmap, "MADV_DONTNEED", None)
_LARGE: Final = getattr(mmap, "MADV_HUGEPAGE", None)


class Reserved:
    """A reserved array, zero where nothing was written.

    Where the system cannot take memory back (Windows), what is given back stays in memory.

    `large_pages` : memory comes megabytes at a time where the system has that, which costs less
    time. For arrays of which a run has few.

    Attributes
    ----------
    array : of the given shape and type.
    """

    def __init__(
        self, shape: tuple[int, ...], dtype: DTypeLike, *, large_pages: bool = False
    ) -> None:
        size = prod(shape) * np.dtype(dtype).itemsize
        self._memory: mmap.mmap | None = None
        self._given_back = 0
        self.array: NDArray[Any]
        if size <= _SMALL or _FORGET is None:
            self.array = np.zeros(shape, dtype)
            return
        flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _NO_RESERVE
        try:
            self._memory = mmap.mmap(-1, size, flags=flags)
        except (OSError, OverflowError, ValueError) as error:
            raise InputError(
                "the run is too long: there are not so many addresses",
                where="run",
                expected=f"{size / 1e9:.0f} GB of address space",
                got=str(error),
                hint="a longer step, a shorter run, or no limit of address space (ulimit -v)",
            ) from error
        if large_pages and _LARGE is not None:
            self._memory.madvise(_LARGE)
        self.array = np.frombuffer(self._memory, dtype).reshape(shape)

    def give_back(self, before: int) -> None:
        """Give back the memory of the entries before this one: they are not read again."""
        if self._memory is None or _FORGET is None:
            return
        begin, self._given_back = forgettable(self.array, before, self._given_back)
        if self._given_back > begin:
            self._memory.madvise(_FORGET, begin, self._given_back - begin)


def forgettable(array: NDArray[Any], before: int, begin: int, offset: int = 0) -> tuple[int, int]:
    """Return from where to where memory is given back [bytes]: whole pages.

    `array` : begins `offset` bytes after the beginning of the memory; `begin` : what lies before it
    was given back already.
    """
    end = (offset + before * array.strides[0]) // mmap.PAGESIZE * mmap.PAGESIZE
    return begin, max(begin, end)
