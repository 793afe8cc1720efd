"""Read ELF shared objects (Linux) with pyelftools."""

from __future__ import annotations

import io
from itertools import islice
from typing import Any

from elftools.elf.dynamic import DynamicSegment
from elftools.elf.elffile import ELFFile
from elftools.elf.gnuversions import GNUVerNeedSection
from elftools.elf.sections import SymbolTableSection

from cosim.fmu.inspect.image import MOST_SYMBOLS, Image, NotALibraryError, version_key
from cosim.fmu.inspect.platforms import Machine

_MACHINES = {
    ("EM_X86_64", 64): "x86_64",
    ("EM_386", 32): "x86",
    ("EM_AARCH64", 64): "aarch64",
    ("EM_ARM", 32): "aarch32",
    ("EM_RISCV", 64): "riscv64",
    ("EM_RISCV", 32): "riscv32",
    ("EM_PPC64", 64): "ppc64",
    ("EM_PPC", 32): "ppc32",
}
_PF_X = 1
_MOST_TABLE = 65536  # segments, sections, tags: more are damage


def read_elf(stream: io.BytesIO) -> list[Image]:
    """Return the image in an ELF file.

    Raises
    ------
    NotALibraryError : an object file or a program.
    """
    elf = ELFFile(stream)
    if elf["e_type"] != "ET_DYN":
        raise NotALibraryError(f"an ELF file of type {elf['e_type']}, not a shared object")
    machine = elf["e_machine"]
    architecture = _MACHINES.get((machine, elf.elfclass), f"{machine} of {elf.elfclass} bits")
    dynamic = next((s for s in _segments(elf) if isinstance(s, DynamicSegment)), None)
    if dynamic is None:
        raise NotALibraryError("an ELF file without a dynamic segment")
    sections = list(islice(elf.iter_sections(), _MOST_TABLE))
    libraries, search = _needed(dynamic)
    tables = [s for s in sections if isinstance(s, SymbolTableSection) and s.name == ".dynsym"]
    exports, imports = _symbols(tables[0] if tables else dynamic)
    return [
        Image(
            format="ELF",
            platform=Machine("linux", architecture),
            exports=exports,
            imports=imports,
            libraries=libraries,
            search=search,
            versions=tuple(sorted(_versions(sections).items())),
            executable_stack=any(
                s["p_type"] == "PT_GNU_STACK" and s["p_flags"] & _PF_X for s in _segments(elf)
            ),
        )
    ]


def _segments(elf: Any) -> list[Any]:
    return list(islice(elf.iter_segments(), _MOST_TABLE))


def _needed(dynamic: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the needed libraries and the folders to look for them."""
    libraries: list[str] = []
    search: list[str] = []
    for tag in islice(dynamic.iter_tags(), _MOST_TABLE):
        kind = tag.entry.d_tag
        if kind == "DT_NEEDED":
            libraries.append(tag.needed)
        elif kind in ("DT_RUNPATH", "DT_RPATH"):
            search += (tag.runpath if kind == "DT_RUNPATH" else tag.rpath).split(":")
    return tuple(libraries), tuple(search)


def _symbols(table: Any) -> tuple[frozenset[str], frozenset[str]]:
    """Return the names that are defined and those that must be found elsewhere."""
    exports: set[str] = set()
    imports: set[str] = set()
    for symbol in islice(table.iter_symbols(), MOST_SYMBOLS):
        bind = symbol["st_info"]["bind"]
        if symbol["st_shndx"] != "SHN_UNDEF" and bind != "STB_LOCAL":
            exports.add(symbol.name)
        elif symbol["st_shndx"] == "SHN_UNDEF" and bind == "STB_GLOBAL":
            imports.add(symbol.name)
    return frozenset(exports), frozenset(imports - {""})


def _versions(sections: list[Any]) -> dict[str, str]:
    """Return by library the highest version of its symbols that is needed."""
    versions = {}
    for section in sections:
        if isinstance(section, GNUVerNeedSection):
            for need, needed in islice(section.iter_versions(), _MOST_TABLE):
                names = [str(aux.name) for aux in islice(needed, _MOST_TABLE)]
                versions[str(need.name)] = max(names, key=version_key)
    return versions
