"""A component as an FMU file: its model name, its flavour, one atomic write."""

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
from cosim.fmu.export.build import FMI_VERSION
from cosim.fmu.export.native.package import build_native_fmu
from cosim.fmu.export.native.platforms import Platform
from cosim.fmu.export.python.package import build_python_fmu
from cosim.fmu.export.spec import ComponentSpec

Flavour = Literal["native", "native-fmi3", "python"]

LONGEST_NAME = 80
"""Characters of a model name: it is a file's name inside the FMU."""


@dataclass(frozen=True)
class FmuTarget:
    """Which FMU is made of a component.

    Attributes
    ----------
    flavour : `native` is FMI 2.0 and `native-fmi3` FMI 3.0, in C; `python` a pythonfmu slave.
    platforms : of a native FMU, to cross-compile for; none is this machine, by its own compiler.
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
        """For people: what it is, and its version of FMI."""
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
            if kind.flavour == "python":
                built = build_python_fmu(spec, Path(folder, "fmu"))
            else:
                version = FMI_VERSION[kind.flavour]
                built = build_native_fmu(spec, Path(folder, "fmu"), version, kind.platforms)
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(built, path)
    except OSError as error:
        raise InputError("the FMU cannot be written", where=str(path), got=str(error)) from error


def model_name(path: Path) -> str:
    """The stem of a path as a name that FMI, C and Python take.

    Raises
    ------
    InputError : nothing is left of it, or too much.
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
    """A model name that is given as such.

    Raises
    ------
    InputError : FMI, C or Python would not take it.
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
