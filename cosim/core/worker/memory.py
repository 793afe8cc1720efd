"""Memory that two processes map; neither can take it away from the other."""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from typing import Final, Self

_DONTFORK: Final = getattr(mmap, "MADV_DONTFORK", None)


class SharedMemory:
    """Memory without a name, which is gone with the processes that map it.

    On Linux it is sealed: nobody can make it shorter, so that what is read in it is there.

    Parameters
    ----------
    descriptor : its file; this object maps it and leaves the descriptor to the caller.
    size : [bytes].

    Attributes
    ----------
    mapping : its bytes.
    """

    def __init__(self, descriptor: int, size: int) -> None:
        self.mapping = mmap.mmap(descriptor, size)

    @classmethod
    def reserve(cls, name: str, size: int) -> tuple[Self, int]:
        """Reserve memory; return it and its file descriptor, which the caller closes.

        Raises
        ------
        OSError : there is not so much.
        """
        if sys.platform == "linux":
            descriptor = os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        else:
            with tempfile.TemporaryFile(prefix=f"{name}-") as file:
                descriptor = os.dup(file.fileno())
        try:
            os.ftruncate(descriptor, size)
            if sys.platform == "linux":
                import fcntl  # noqa: PLC0415 - not on every system

                seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
                fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
            return cls(descriptor, size), descriptor
        except BaseException:
            os.close(descriptor)
            raise

    def keep_from_forks(self) -> None:
        """Keep it out of the processes that are forked from this one from now on."""
        if _DONTFORK is not None:
            self.mapping.madvise(_DONTFORK)
