"""Platforms: the folders of binaries that name them, and that of this machine."""

from __future__ import annotations

import platform
import re
import sys
from types import MappingProxyType
from typing import NamedTuple


class Machine(NamedTuple):
    """A system and an architecture, named as in FMI 3."""

    system: str
    architecture: str

    @property
    def suffix(self) -> str:
        """The file suffix of its libraries."""
        return {"windows": ".dll", "darwin": ".dylib"}.get(self.system, ".so")


FMI2 = MappingProxyType(
    {
        "linux32": Machine("linux", "x86"),
        "linux64": Machine("linux", "x86_64"),
        "win32": Machine("windows", "x86"),
        "win64": Machine("windows", "x86_64"),
        "darwin32": Machine("darwin", "x86"),
        "darwin64": Machine("darwin", "x86_64"),
    }
)
"""Folder of FMI 1 and 2 -> platform."""

_TUPLE = re.compile(
    r"(?P<arch>aarch32|aarch64|riscv32|riscv64|x86|x86_64|ppc32|ppc64)"
    r"-(?P<sys>darwin|linux|windows)(?:-[a-z0-9]+)?"
)
_MACHINES = MappingProxyType(
    {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86", "ppc64le": "ppc64"}
)
"""Name in Python -> name in FMI 3, where they differ."""


def named_by_tuple(folder: str) -> Machine | None:
    """Return the platform of a folder named as in FMI 3: <arch>-<sys>[-<abi>]."""
    found = _TUPLE.fullmatch(folder)
    return Machine(found["sys"], found["arch"]) if found else None


def this_libc() -> tuple[int, ...] | None:
    """Return the version of this machine's GNU C library, as (2, 36); None if it has another."""
    name, version = platform.libc_ver()
    numbers = version.split(".")
    return tuple(map(int, numbers)) if name == "glibc" and all(map(str.isdigit, numbers)) else None


def this_machine() -> Machine:
    """Return the platform that this interpreter runs on."""
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    machine = platform.machine().lower()
    return Machine(system, _MACHINES.get(machine, machine))
