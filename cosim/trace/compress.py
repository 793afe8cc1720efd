"""Compress chunks, two at a time where there are two processors."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import lz4.frame
import zstandard

Data = bytes | memoryview


class Compressor:
    """A compressor of chunks.

    It uses zstd at the default level; for data that hardly compress (doubles full of noise) at
    level 1, which takes half the time for a file one hundredth larger. The first of every
    `WINDOW` chunks decides for the others, so that the bytes depend on the chunks alone.

    Parameters
    ----------
    name : as in MCAP: "zstd", "lz4", or "" for none.
    """

    WINDOW = 24
    LITTLE = 0.75
    """Compressed share of its size above which a chunk counts as hardly compressible."""

    def __init__(self, name: str) -> None:
        self.name = name
        # the second of each pair is for the helper thread: zstd's are not thread-safe
        self._usual = [zstandard.ZstdCompressor() for _ in range(2)]
        self._fast = [zstandard.ZstdCompressor(level=1) for _ in range(2)]
        self._level = self._usual
        self._left = 0

    def __call__(self, chunks: Sequence[Data]) -> list[Data]:
        """Return the compressed data of each chunk."""
        if self.name == "":
            return list(chunks)
        if self.name == "lz4":
            return [lz4.frame.compress(data) for data in chunks]
        packed: list[Data] = []
        while len(packed) < len(chunks):
            if self._left == 0:
                first = chunks[len(packed)]
                packed.append(self._usual[0].compress(first))
                little = len(packed[-1]) > self.LITTLE * len(first)
                self._level, self._left = self._fast if little else self._usual, self.WINDOW
            else:
                some = chunks[len(packed) : len(packed) + self._left]
                packed += self._together(some)
                self._left -= len(some)
        return packed

    def _together(self, chunks: Sequence[Data]) -> list[Data]:
        ours, theirs = self._level
        half = len(chunks) // 2
        helper = _ask(lambda: [theirs.compress(data) for data in chunks[:half]]) if half else None
        if helper is None:
            return [ours.compress(data) for data in chunks]
        rest = [ours.compress(data) for data in chunks[half:]]
        return [*helper.result(), *rest]


_helper: ThreadPoolExecutor | None = None


def _ask(work: Callable[[], list[bytes]]) -> Future[list[bytes]] | None:
    """Run work in another thread; None where that is impossible or would not help."""
    global _helper  # noqa: PLW0603 - one thread for all traces of the process
    if (os.cpu_count() or 1) < 2:
        return None
    if _helper is None:
        _helper = ThreadPoolExecutor(1, thread_name_prefix="trace-compress")
    try:
        return _helper.submit(work)
    except RuntimeError:  # the interpreter is ending
        return None


def _forget() -> None:
    global _helper  # noqa: PLW0603 - its thread is not in a forked process
    _helper = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
