"""The headers of a library, as the loader of an operating system reads them."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.fmu.inspect.platforms import Machine

MOST_SYMBOLS = 500_000


class NotALibraryError(Exception):
    """A file in a library's format that is not a library."""


@dataclass(frozen=True, slots=True)
class Image:
    """The headers of a library for one architecture.

    Attributes
    ----------
    format : ELF, PE or Mach-O.
    platform : what it is built for; the system of an ELF file is taken to be Linux.
    exports : symbols it defines; None: its headers do not say.
    imports : symbols it needs from elsewhere (of PE files, from any library).
    libraries : those it needs.
    search : folders where the loader is to look for them.
    versions : library -> highest symbol version needed, as libc.so.6 -> GLIBC_2.17.
    executable_stack : whether it asks for an executable stack.
    """

    format: str
    platform: Machine
    exports: frozenset[str] | None
    imports: frozenset[str]
    libraries: tuple[str, ...]
    search: tuple[str, ...] = ()
    versions: tuple[tuple[str, str], ...] = ()
    executable_stack: bool = False

    @property
    def functions(self) -> frozenset[str]:
        """The exported FMI functions: fmi2DoStep, or Model_fmiDoStep in FMI 1."""
        return frozenset(n for n in self.exports or () if n.startswith("fmi") or "_fmi" in n)

    @property
    def libc(self) -> tuple[int, ...] | None:
        """The oldest GNU C library that it loads with, or None."""
        found = [
            version_key(version)
            for _, version in self.versions
            if version.startswith("GLIBC_") and version != "GLIBC_PRIVATE"
        ]
        return max(found, default=None)

    @property
    def needs_python(self) -> bool:
        """Whether it calls a Python interpreter that it does not load itself."""
        python = any(name.startswith(("_Py", "Py")) for name in self.imports)
        return python and not any("python" in name.lower() for name in self.libraries)


def version_key(version: str) -> tuple[int, ...]:
    """Return GLIBC_2.17 as (2, 17)."""
    numbers = version.partition("_")[2].split(".")
    return tuple(int(n) for n in numbers if n.isdigit())
