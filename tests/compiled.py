"""FMUs in C that the tests compile with the system's compiler."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import fmpy
import pytest

_HEADERS = Path(__file__).parents[1] / "cosim" / "fmu" / "export" / "native" / "c" / "headers"


def compile_fmu(
    source: Path,
    description: str,
    path: Path,
    *flags: str,
    resources: Mapping[str, str] | None = None,
) -> Path:
    """Make the FMU `path` of one C file and its model description, and return its path.

    flags : of the compiler, beside those that make every warning an error.
    resources : name -> text of the files in the folder of that name.

    The test is skipped without a compiler.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler (cc)")
    line = [compiler, "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{_HEADERS}"]
    identifier = re.findall('modelIdentifier="(.*?)"', description)[0]
    platform = fmpy.platform if 'fmiVersion="2.0"' in description else fmpy.platform_tuple
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path, "w") as archive:
        library = Path(folder) / f"{identifier}{fmpy.sharedLibraryExtension}"
        command = [*line, *flags, str(source), "-lm", "-o", str(library)]
        subprocess.run(command, check=True)  # noqa: S603 - our own source
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{platform}/{library.name}")
        for name, text in (resources or {}).items():
            archive.writestr(f"resources/{name}", text)
    return path
