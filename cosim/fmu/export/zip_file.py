"""Write archives whose bytes depend on their content alone."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

from cosim.core import written_beside

_DATE = (1980, 1, 1, 0, 0, 0)


def deterministic_zip(files: Mapping[str, bytes], destination: Path) -> Path:
    """Write the files, sorted and with a fixed date; replace `destination` atomically.

    Stored, not deflated: builds of zlib compress the same bytes differently, and an FMU is
    unpacked before use anyway.
    """
    with (
        written_beside(destination) as partial,
        zipfile.ZipFile(partial, "w", zipfile.ZIP_STORED) as archive,
    ):
        for name in sorted(files):
            info = zipfile.ZipInfo(name, _DATE)
            info.external_attr = 0o100644 << 16
            info.create_system = 3  # the same on every host
            archive.writestr(info, files[name])
    return destination
