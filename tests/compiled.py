"""FMUs in C that the tests compile with the system's compiler."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import fmpy
import pytest

HEADERS = Path(fmpy.__file__).parent / "c-code"
"""The folder of the headers of FMI 1.0, 2.0 and 3.0."""
_SHARED = Path(__file__).parent
"""The folder of slave.h, which has what the slaves share."""


def compile_fmu(
    source: Path,
    description: str,
    path: Path,
    *flags: str,
    resources: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
) -> Path:
    """Make the FMU `path` of one file in C or C++ and its model description, and return its path.

    flags : of the compiler, beside those that make every warning an error.
    resources : name -> text of the files in the folder of that name.
    files : path -> text of further files.

    The test is skipped without a compiler.
    """
    identifier = re.findall('modelIdentifier="(.*?)"', description)[0]
    platform = fmpy.platform_tuple if 'fmiVersion="3.0' in description else fmpy.platform
    library = f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}"
    packed: dict[str, str | bytes] = {
        "modelDescription.xml": description,
        library: _library(source.read_text("utf-8"), source.parent, flags, source.suffix),
        **{f"resources/{name}": text for name, text in (resources or {}).items()},
        **(files or {}),
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in packed.items():
            entry = zipfile.ZipInfo(name)  # without the time of day: made again, it is the same FMU
            entry.external_attr = 0o600 << 16
            archive.writestr(entry, content)
    return path


@cache
def _library(text: str, home: Path, flags: tuple[str, ...], suffix: str) -> bytes:
    """The shared library of a C or C++ file that stands in `home`, compiled once per process."""
    name = {".c": "cc", ".cpp": "c++"}[suffix]
    compiler = shutil.which(name)
    if compiler is None:
        pytest.skip(f"needs a compiler ({name})")
    strict = ("-O1", "-Wall", "-Wextra", "-Werror", *(f"-I{p}" for p in (HEADERS, _SHARED, home)))
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / f"source{suffix}", Path(folder) / "library"
        source.write_text(text, "utf-8")
        line = [compiler, *strict, "-shared", "-fPIC", *flags, source, "-lm", "-o", library]
        subprocess.run(line, check=True)  # noqa: S603 - our own source
        return library.read_bytes()
