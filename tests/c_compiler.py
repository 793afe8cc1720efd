"""The C compiler of this machine, for what tests compile themselves."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest


def c_compiler() -> list[str]:
    """Its command: $CC, or the first of cc, gcc and clang; without one the test is skipped."""
    chosen = os.environ.get("CC", "").strip()
    for command in [chosen] if chosen else ["cc", "gcc", "clang"]:
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return words
    pytest.skip("needs a C compiler")


def compile_c(*words: str, folder: Path | None = None) -> str:
    """Run it with these words, in a folder; what it writes to standard error."""
    line = [*c_compiler(), *words]
    done = subprocess.run(line, check=False, capture_output=True, text=True, cwd=folder)  # noqa: S603
    assert done.returncode == 0, done.stderr
    return done.stderr
