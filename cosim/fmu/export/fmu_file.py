"""Write a component as one FMU file: its model name, flavour and platforms."""

from __future__ import annotations

import keyword
import re
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cosim.core import InputError
from cosim.fmu.export.build import FMI_VERSION, build_fmu
from cosim.fmu.export.native.platforms import Platform
from cosim.fmu.export.spec import ComponentSpec

Flavour = Literal["native", "native-fmi3", "python"]
"""FMI 2.0 in C, FMI 3.0 in C, or FMI 2.0 as a Python slave."""

LONGEST_NAME = 80
"""Greatest length of a model name, which is a file name inside the FMU."""


@dataclass(frozen=True)
class FmuTarget:
    """The kind of FMU to make of a component.

    Attributes
    ----------
    flavour : `native` (FMI 2.0 in C), `native-fmi3` (FMI 3.0 in C) or `python` (pythonfmu).
    platforms : to cross-compile a native FMU for; none: this machine, by its own compiler.
    """

    flavour: Flavour = "native"
    platforms: Sequence[Platform] = ()

    def __post_init__(self) -> None:
        if self.flavour == "python" and self.platforms:
            raise InputError(
                "an FMU in Python has no platforms of its own",
                where="--platforms",
                expected="host",
                hint="--flavour native",
            )

    @property
    def text(self) -> str:
        """The version of FMI and the flavour in words."""
        what = "pythonfmu, needs a Python host" if self.flavour == "python" else "native"
        return f"FMI {FMI_VERSION[self.flavour]}, {what}"


def write_fmu(spec: ComponentSpec, path: Path, kind: FmuTarget) -> None:
    """Write the FMU of a component; the same content gives the same bytes.

    Raises
    ------
    InputError : no compiler for a native one, or a file that cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="cosim-fmu-") as folder:
            built = build_fmu(spec, Path(folder, "fmu"), kind.flavour, kind.platforms)
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(built, path)
    except OSError as error:
        raise InputError("the FMU cannot be written", where=str(path), got=str(error)) from error


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
            hint="another file: --out",
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
            where="--name",
            expected=f"ASCII letters, digits, _; a letter first; at most {LONGEST_NAME}",
            got=name,
        )
    return name
