"""Compress chunks, two at a time where there are two processors."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import lz4.frame
import zstandard

Data = bytes | memoryview


_QUICK = zstandard.ZstdCompressionParameters(
    strategy=zstandard.STRATEGY_FAST,
    window_log=18,
    hash_log=12,
    chain_log=10,
    search_log=1,
    min_match=4,
    target_length=1,
)
"""How zstd looks for repetitions.

What repeats in records is short: a tag, and sign, exponent and first digits of the double before
it. The fast strategy looks for 6 bytes or more at zstd's level 1; told to take 4, it needs half the
time of level 3, for files from a tenth smaller (200 smooth signals) to 3 % larger (real runs).
"""


class Compressor:
    """A compressor of chunks; its bytes depend on the chunks alone.

    Parameters
    ----------
    name : as in MCAP: "zstd", "lz4", or "" for none.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        # the second is for the helper thread: zstd's are not thread-safe
        self._ours, self._theirs = (
            zstandard.ZstdCompressor(compression_params=_QUICK) for _ in range(2)
        )

    def __call__(self, chunks: Sequence[Data]) -> list[Data]:
        """Return the compressed data of each chunk."""
        if self.name == "":
            return list(chunks)
        if self.name == "lz4":
            return [lz4.frame.compress(data) for data in chunks]
        half = len(chunks) // 2
        first, theirs = chunks[:half], self._theirs
        helper = _ask(lambda: [theirs.compress(data) for data in first]) if half else None
        if helper is None:
            return [self._ours.compress(data) for data in chunks]
        rest = [self._ours.compress(data) for data in chunks[half:]]
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
