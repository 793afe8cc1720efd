"""Write a component as one FMU file: its model name, flavour and platforms."""

from __future__ import annotations

import keyword
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.core import InputError, copy_whole, not_written
from cosim.fmu.compiled.prebuilt import prebuilt_platforms, why_none_prebuilt
from cosim.fmu.export.build import build_fmu
from cosim.fmu.export.flavours import FMI_VERSION, Flavour
from cosim.fmu.export.native.target_platforms import (
    PLATFORMS,
    Platform,
    has_cross_compiler,
    platforms_named,
)
from cosim.fmu.export.spec import ComponentSpec
from cosim.fmu.unpacking import own_folder

LONGEST_NAME = 80
"""Greatest length of a model name, which is a file name inside the FMU."""


@dataclass(frozen=True)
class FmuTarget:
    """The kind of FMU to make of a component.

    Attributes
    ----------
    flavour : `native` (FMI 2.0 in C), `native-fmi3` (FMI 3.0 in C) or `python` (pythonfmu).
    platforms : to cross-compile a native FMU for; none: those that are prebuilt, or this machine,
        by its own compiler.
    prebuilt : whether to use the binaries that the wheel brings, if it does.
    clocked : with event mode and an input Clock, see `build_fmu`.
    """

    flavour: Flavour = "native"
    platforms: Sequence[Platform] = ()
    prebuilt: bool = True
    clocked: bool = False

    def __post_init__(self) -> None:
        if self.flavour == "python" and self.platforms:
            raise InputError(
                "an FMU in Python has no platforms of its own",
                where="`platforms`",
                expected="host",
                hint="`flavour` native",
            )

    @property
    def text(self) -> str:
        """The version of FMI and the flavour in words."""
        return f"FMI {FMI_VERSION[self.flavour]}, {self._origin}"

    @property
    def _origin(self) -> str:
        if self.flavour == "python":
            return "pythonfmu, needs a Python host"
        if self.platforms:
            return "native, cross-compiled"
        ready = self.prebuilt and not self.clocked and why_none_prebuilt() is None
        return "native, prebuilt for all platforms" if ready else "native, compiled on this machine"


def target_named(flavour: Flavour, platforms: str, *, clocked: bool = False) -> FmuTarget:
    """Return the kind of FMU with the platforms that a text names: prebuilt, host, all, or a list.

    Without a cross compiler, "all" are the prebuilt binaries, if these are for all platforms.

    Raises
    ------
    InputError : a platform that does not exist, or platforms of an FMU in Python.
    """
    is_prebuilt = platforms == "prebuilt"
    if platforms == "all" and flavour != "python" and not clocked:
        is_prebuilt = not has_cross_compiler() and prebuilt_platforms().issuperset(PLATFORMS)
    if is_prebuilt:
        return FmuTarget(flavour, clocked=clocked)
    named = platforms_named(platforms, "prebuilt")
    return FmuTarget(flavour, named, prebuilt=False, clocked=clocked)


def write_fmu(component: str | ComponentSpec, path: Path, kind: FmuTarget) -> None:
    """Write the FMU of a component, as `build_fmu`; the same content gives the same bytes.

    Raises
    ------
    InputError : no compiler for a native one, or a file that cannot be written.
    """
    with (
        not_written("the FMU", path),
        tempfile.TemporaryDirectory(prefix="fmu-", dir=own_folder()) as folder,
    ):
        built = build_fmu(
            *(component, Path(folder, "fmu"), kind.flavour, kind.platforms),
            prebuilt=kind.prebuilt,
            clocked=kind.clocked,
        )
        copy_whole(built, path)


def model_name(path: Path) -> str:
    """Make a model name of the stem of a path, valid in FMI, C and Python.

    Raises
    ------
    InputError : nothing is left of it, or it is too long.
    """
    name = re.sub(r"[^A-Za-z0-9]+", "_", path.stem).strip("_")
    if not name:
        raise InputError(
            "this file name gives no model name",
            where=str(path),
            expected="a name with ASCII letters or digits",
            hint="another file: `out`",
        )
    return checked_name(f"M_{name}" if name[0].isdigit() or keyword.iskeyword(name) else name)


def checked_name(name: str) -> str:
    """Return a model name after checking it.

    Raises
    ------
    InputError : not valid in FMI, C or Python.
    """
    fits = re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) and not keyword.iskeyword(name)
    if not fits or len(name) > LONGEST_NAME:
        raise InputError(
            "this is no model name",
            where="`name`",
            expected=f"ASCII letters, digits, _; a letter first; at most {LONGEST_NAME}",
            got=name,
        )
    return name
