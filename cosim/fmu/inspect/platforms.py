"""Folders of binaries: what their names mean, and which one is this machine's."""

from __future__ import annotations

import platform
import re
import sys
from types import MappingProxyType
from typing import NamedTuple


class Platform(NamedTuple):
    """A system and an architecture, in the words of FMI 3."""

    system: str
    architecture: str

    @property
    def suffix(self) -> str:
        """How the name of its libraries ends."""
        return {"windows": ".dll", "darwin": ".dylib"}.get(self.system, ".so")


FMI2 = MappingProxyType(
    {
        "linux32": Platform("linux", "x86"),
        "linux64": Platform("linux", "x86_64"),
        "win32": Platform("windows", "x86"),
        "win64": Platform("windows", "x86_64"),
        "darwin32": Platform("darwin", "x86"),
        "darwin64": Platform("darwin", "x86_64"),
    }
)
"""The folders of FMI 1 and 2."""

_TUPLE = re.compile(
    r"(?P<arch>aarch32|aarch64|riscv32|riscv64|x86|x86_64|ppc32|ppc64)"
    r"-(?P<sys>darwin|linux|windows)(?:-[a-z0-9]+)?"
)
_MACHINES = MappingProxyType(
    {
        "x86_64": "x86_64",
        "AMD64": "x86_64",
        "amd64": "x86_64",
        "aarch64": "aarch64",
        "arm64": "aarch64",
        "ARM64": "aarch64",
        "i386": "x86",
        "i686": "x86",
        "x86": "x86",
        "riscv64": "riscv64",
        "ppc64le": "ppc64",
    }
)


def named_by_tuple(folder: str) -> Platform | None:
    """What a folder's name means in FMI 3: <arch>-<sys>[-<abi>]."""
    found = _TUPLE.fullmatch(folder)
    return Platform(found["sys"], found["arch"]) if found else None


def this_libc() -> tuple[int, ...] | None:
    """The GNU C library of this machine, as (2, 36); None where there is another."""
    name, version = platform.libc_ver()
    numbers = version.split(".")
    return tuple(map(int, numbers)) if name == "glibc" and all(map(str.isdigit, numbers)) else None


def this_machine() -> Platform:
    """The platform this interpreter runs on."""
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    return Platform(system, _MACHINES.get(platform.machine(), platform.machine()))
