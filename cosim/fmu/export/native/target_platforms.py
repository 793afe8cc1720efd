"""The platforms of a native FMU: folder names of FMI 2 and FMI 3, compiler targets."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from types import MappingProxyType

from cosim.core import InputError
from cosim.fmu.inspect.platforms import this_machine


@dataclass(frozen=True)
class Platform:
    """A platform that a binary is built for.

    Attributes
    ----------
    tuple_name : architecture and system, as FMI 3.0 names the folder.
    fmi2 : the folder in FMI 2.0; that of FMI 3.0 where 2.0 has none.
    suffix : of a shared library.
    zig : target of the cross compiler, with the oldest C library that is supported.
    """

    tuple_name: str
    fmi2: str
    suffix: str
    zig: str

    def folder(self, fmi_version: str) -> str:
        """Return the name of its folder below binaries/."""
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
"""FMI 3.0 platform tuple -> platform, for all that can be cross-compiled."""


def host() -> Platform:
    """Return the platform of this machine, also if it is not among `PLATFORMS`."""
    here = this_machine()
    name = f"{here.architecture}-{here.system}"
    return PLATFORMS.get(name, Platform(name, name, here.suffix, ""))


def has_cross_compiler() -> bool:
    """Whether zig's C compiler is here, from the extra `cross`."""
    return importlib.util.find_spec("ziglang") is not None


def platforms_named(text: str, *others: str) -> tuple[Platform, ...]:
    """Return the platforms that `host` (none: no cross-compiling), `all` or a list names.

    `others`: words that the caller takes beside these, for the message.

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
                "platform", name, (*others, "host", "all", *PLATFORMS), where="`platforms`"
            )
    return tuple(PLATFORMS[name] for name in PLATFORMS if name in names)
