"""Find the FMUs of a scenario, and build those that are missing."""

from __future__ import annotations

import errno
import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cosim.core import InputError, cache_folder, say_once
from cosim.fmu import FmuDescription, describe_fmu, own_folder
from cosim.fmu.export import (
    CATALOGUE,
    DEFAULT_FLAVOUR,
    ComponentSpec,
    ensure_design_fmu,
    ensure_fmu,
    ensure_made,
)
from cosim.scenario.design_files import design_content

_READ_ONLY = (errno.EACCES, errno.EPERM, errno.EROFS)


@dataclass(frozen=True)
class FmuCache:
    """A folder in which FMUs are found by name, path or hash, and built if missing.

        >>> from pathlib import Path
        >>> from cosim.scenario import FmuCache
        >>> FmuCache(Path("fmus")).find("Sensor").ports["y[1]"].unit
        'm'

    Attributes
    ----------
    root : folder with FLAVOUR/NAME.fmu; missing FMUs of the catalogue are built there.
    folder : start of relative paths of a scenario; by default the present folder.
    wanted : FMU reference -> SHA-256 of its file, which may lie anywhere below `root` under any
        name; if there is no such file, the reference is resolved as usual.
    flavour : flavour of catalogue FMUs, a key of `cosim.fmu.FMI_VERSION`.
    """

    root: Path
    folder: Path = Path()
    wanted: Mapping[str, str] = field(default_factory=dict)
    flavour: str = DEFAULT_FLAVOUR

    def __post_init__(self) -> None:
        # wherever the process goes afterwards
        object.__setattr__(self, "root", Path(self.root).absolute())
        object.__setattr__(self, "folder", Path(self.folder).absolute())

    def find(self, fmu: str) -> FmuDescription:
        """Find an FMU by its hash if one is wanted, else by catalogue name, design or path."""
        if fmu in self.wanted:
            for path in sorted(self.root.rglob("*.fmu")):
                if hashlib.sha256(path.read_bytes()).hexdigest() == self.wanted[fmu]:
                    found = describe_fmu(path)
                    if found.sha256 == self.wanted[fmu]:  # it may have changed meanwhile
                        return found
        if fmu in CATALOGUE:
            return describe_fmu(self._built(fmu, lambda root: self._of_catalogue(fmu, root)))
        if not fmu.endswith(".fmu"):
            design, apart, part = fmu.rpartition(":")
            if not apart:
                raise self._unknown(fmu)
            return describe_fmu(self._built(fmu, lambda root: self._of_design(design, part, root)))
        path = Path(fmu)
        return describe_fmu(path if path.is_absolute() else self.folder / path)

    def made(self, spec: ComponentSpec, what: str) -> FmuDescription:
        """Return the FMU of a component that a scenario describes in `what`; build it if missing.

        It is kept in the user's cache: nobody chose this file, and an identical one can be made
        again.

        Raises
        ------
        InputError : different names that are the same in C, or an FMU that cannot be built.
        """
        named = replace(spec, name=re.sub(r"[^A-Za-z0-9]+", "_", spec.name))
        for folder in (cache_folder(), own_folder()):
            try:
                return describe_fmu(ensure_made(named, folder / "made", self.flavour))
            except ValueError as error:
                if isinstance(error, InputError):
                    raise
                raise InputError("its variables cannot be told apart", got=str(error)) from error
            except OSError as error:
                failed = error
        raise _not_built(what, folder, failed) from failed

    def _of_catalogue(self, fmu: str, root: Path) -> Path:
        return ensure_fmu(fmu, root, flavour=self.flavour).path

    def _of_design(self, design: str, part: str, root: Path) -> Path:
        """Return the FMU of a part of a design: a name of the package, or a file."""
        where, content = design_content(design, self.folder)
        name = Path(design).stem
        built = ensure_design_fmu(content, name, part, root, flavour=self.flavour, where=where)
        return built.path

    def _built(self, fmu: str, ensure: Callable[[Path], Path]) -> Path:
        """Return an FMU that is built if it is missing.

        Where `root` cannot be written, in a temporary folder that lives as long as the process.
        """
        try:
            return ensure(self.root)
        except OSError as error:
            if error.errno not in _READ_ONLY:  # such as a file in place of the folder
                raise _not_built(fmu, self.root, error) from error
            say_once(
                f"{self.root} cannot be written ({error.strerror}): FMUs are built in a temporary "
                "folder, and built again by the next command; --fmus of the command names another"
            )
        folder = own_folder() / "built"
        try:
            return ensure(folder)
        except OSError as error:
            raise _not_built(fmu, folder, error) from error

    def _unknown(self, fmu: str) -> InputError:
        """Return the error for a name that is no FMU of the catalogue."""
        hint = "the path of an FMU ends in .fmu"
        wrong = InputError.unknown(
            "FMU", fmu, [*CATALOGUE, "FILE.fmu", "DESIGN:PART"], where="components", hint=hint
        )
        if (self.folder / f"{fmu}.fmu").is_file():
            wrong.hint = f"did you mean {fmu}.fmu?"
        return wrong


def _not_built(fmu: str, folder: Path, error: OSError) -> InputError:
    return InputError(
        f"the FMU {fmu} cannot be built",
        where=str(folder),
        expected="a folder that can be written",
        got=str(error),
        hint="another folder: `fmus`",
    )
