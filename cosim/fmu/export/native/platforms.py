"""The platforms of a native FMU: folder names of FMI 2 and FMI 3, compiler targets."""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass
from types import MappingProxyType

from cosim.core import InputError


@dataclass(frozen=True)
class Platform:
    """Where a binary runs.

    Attributes
    ----------
    tuple_name : architecture and system, as FMI 3.0 names the folder.
    fmi2 : the folder of FMI 2.0; where 2.0 has no name for it, that of FMI 3.0.
    suffix : of a shared library.
    zig : target of the cross compiler, the oldest C library that is accepted included.
    """

    tuple_name: str
    fmi2: str
    suffix: str
    zig: str

    def folder(self, fmi_version: str) -> str:
        """binaries/<folder> for an FMI version."""
        return self.fmi2 if fmi_version.startswith("2") else self.tuple_name


PLATFORMS = MappingProxyType(
    {
        p.tuple_name: p
        for p in (
            Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
            Platform("aarch64-linux", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
            Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
            Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos.11.0"),
            Platform("aarch64-darwin", "aarch64-darwin", ".dylib", "aarch64-macos.11.0"),
        )
    }
)
"""FMI 3.0 platform tuple -> platform, for all that are cross-compiled."""


def host() -> Platform:
    """The platform of this machine; also one that is not among `PLATFORMS`."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system, suffix = {"win32": ("windows", ".dll"), "darwin": ("darwin", ".dylib")}.get(
        sys.platform, ("linux", ".so")
    )
    name = f"{machine}-{system}"
    return PLATFORMS.get(name, Platform(name, name, suffix, ""))


def platforms_named(text: str) -> tuple[Platform, ...]:
    """From `host` (none: the machine's own compiler), `all`, or names with commas.

    Raises
    ------
    InputError : a platform that does not exist.
    """
    if text == "host":
        return ()
    names = list(PLATFORMS) if text == "all" else text.split(",")
    for name in names:
        if name not in PLATFORMS:
            raise InputError.unknown(
                "platform", name, ("host", "all", *PLATFORMS), where="--platforms"
            )
    return tuple(PLATFORMS[name] for name in PLATFORMS if name in names)
