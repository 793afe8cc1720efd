"""Memory that parent and child map: words about the call in progress, then the rows."""

from __future__ import annotations

import errno
import mmap
from math import prod
from typing import Final

import numpy as np

from cosim.core import InputError, SharedMemory
from cosim.master.component_instance import Rows
from cosim.master.reserved import forgettable
from cosim.master.table import ROW_SUM, WORDS

_COMPLETE, _STOP, _TURN, _TIME, _LENGTH, _DELIVERED, _SIGNS = range(7)
_CELL: Final = 64
_TEXT: Final = 128
_PROGRESS: Final = 1024
_HEAD: Final = 4096
_REMOVE: Final = getattr(mmap, "MADV_REMOVE", None)


class SharedRun:
    """The shared memory of one run.

    Attributes
    ----------
    word : what the loop is doing, as in `cosim.master.table.Table`.
    """

    def __init__(self, memory: SharedMemory) -> None:
        self._shared = memory
        self._memory = memory.mapping
        self._words = memoryview(self._memory)[:_TEXT].cast("q")
        self.word = np.frombuffer(self._memory, np.int64, WORDS, _PROGRESS)

    def keep_from_forks(self) -> None:
        """Keep the memory out of the processes that are forked from this one from now on."""
        self._shared.keep_from_forks()

    def rows(self, shape: tuple[int, int]) -> SharedRows:
        """Return the memory of a shape that `wire` asks for: the rows, or a single cell."""
        return SharedRows(self._memory, shape, _CELL if shape == (1, 1) else _HEAD)

    @property
    def complete(self) -> int:
        """The number of complete rows, as the child told last."""
        return self._words[_COMPLETE]

    @complete.setter
    def complete(self, rows: int) -> None:
        self._words[_COMPLETE] = rows

    @property
    def delivered(self) -> int:
        """The number of rows that the parent's observers have."""
        return self._words[_DELIVERED]

    @delivered.setter
    def delivered(self, rows: int) -> None:
        self._words[_DELIVERED] = rows

    @property
    def stop_requested(self) -> bool:
        """Whether the parent wants the child to stop between two steps."""
        return bool(self._words[_STOP])

    def request_stop(self) -> None:
        """Ask the child to stop between two steps."""
        self._words[_STOP] = 1

    def clear_stop(self) -> None:
        """Take the request to stop back."""
        self._words[_STOP] = 0

    def begin_call(self, time_ns: int, component: str, call: str) -> None:
        """Note that a call outside the loop begins: at the start, by events, at the end."""
        text = f"{component}\0{call}".encode()[: _PROGRESS - _TEXT]
        self._memory[_TEXT : _TEXT + len(text)] = text
        self._words[_TIME], self._words[_LENGTH] = time_ns, len(text)
        self._words[_TURN] += 1 + self._words[_TURN] % 2  # odd during a call

    def end_call(self) -> None:
        """Note that the call outside the loop has returned."""
        self._words[_TURN] += self._words[_TURN] % 2

    def outside_call(self) -> tuple[str, str, int] | None:
        """Return component, call and time [ns] of the call outside the loop in progress."""
        if not self._words[_TURN] % 2:
            return None
        raw = bytes(self._memory[_TEXT : _TEXT + self._words[_LENGTH]])
        component, _, call = raw.decode("utf-8", "replace").partition("\0")
        return component, call, self._words[_TIME]

    def show_life(self) -> None:
        """Note that the child goes on, where no call and no row shows it."""
        self._words[_SIGNS] += 1

    @property
    def sign_of_life(self) -> tuple[int, ...]:
        """Something that is different whenever the child has gone on."""
        words = self._words
        loop = int(self.word[0]), int(self.word[1])
        return (*loop, words[_TURN], words[_COMPLETE], words[_SIGNS])

    @property
    def row_sum(self) -> int:
        """The sum of the complete rows, as the loop has found it (`cosim.master.row_sums`)."""
        return int(self.word[ROW_SUM])

    @property
    def in_loop(self) -> bool:
        """Whether an operation of the loop is in progress."""
        return bool(self.word[1])


class SharedRows:
    """Rows in memory that two processes map; as `Reserved`, for both."""

    def __init__(self, memory: mmap.mmap, shape: tuple[int, int], begin: int) -> None:
        self._memory, self._begin = memory, begin
        self._given_back = mmap.PAGESIZE
        rows: Rows = np.frombuffer(memory, np.float64, prod(shape), begin)
        self.array = rows.reshape(shape)

    def give_back(self, before: int) -> None:
        """Give back the memory of the rows before this one: nobody reads them again."""
        begin, end = forgettable(self.array, before, self._given_back, self._begin)
        if end > begin and _REMOVE is not None:
            self._memory.madvise(_REMOVE, begin, end - begin)
        self._given_back = end


def reserve(shape: tuple[int, int]) -> tuple[SharedRun, int, int]:
    """Reserve memory for rows of a shape; return it, its file descriptor and its size [bytes].

    Raises
    ------
    InputError : there is not so much.
    """
    size = _HEAD + 8 * prod(shape)
    try:
        memory, descriptor = SharedMemory.reserve("cosim-rows", size)
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):  # no lack of memory
            raise
        raise InputError(
            "the rows of the run do not fit into memory that two processes share",
            where="run",
            expected=f"{size / 1e6:.0f} MB",
            got=str(error),
            hint="a greater limit of file sizes (ulimit -f), or a run that is not supervised",
        ) from error
    return SharedRun(memory), descriptor, size
