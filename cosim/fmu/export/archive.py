"""Write archives whose bytes depend on their content alone."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path

_DATE = (1980, 1, 1, 0, 0, 0)


def deterministic_zip(files: Mapping[str, bytes], destination: Path) -> Path:
    """Write the files, sorted and with a fixed date; replace `destination` atomically.

    Stored, not deflated: builds of zlib compress the same bytes differently, and an FMU is
    unpacked before use anyway.
    """
    destination.parent.mkdir(parents=True, exist_ok=True)
    partial = destination.with_suffix(f".{os.getpid()}.partial")
    try:
        with zipfile.ZipFile(partial, "w", zipfile.ZIP_STORED) as archive:
            for name in sorted(files):
                info = zipfile.ZipInfo(name, _DATE)
                info.external_attr = 0o100644 << 16
                info.create_system = 3  # the same on every host
                archive.writestr(info, files[name])
        partial.replace(destination)
    finally:
        partial.unlink(missing_ok=True)
    return destination
