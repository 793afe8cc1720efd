"""Where the FMUs of a scenario are found and built."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cosim.core import InputError
from cosim.fmu import CATALOGUE, DEFAULT_FLAVOUR, FmuDescription, describe_fmu, ensure_fmu


@dataclass(frozen=True)
class FmuCache:
    """Where FMUs are found and built.

    Attributes
    ----------
    root : folder with FLAVOUR/NAME.fmu; what the catalogue has and is missing is built there.
    folder : where relative paths of a scenario begin.
    wanted : FMU reference -> SHA-256 that its file must have, wherever below `root` it lies
        and whatever it is called; if there is none, the reference is followed as usual.
    flavour : which FMUs a catalogue name means, a key of `cosim.fmu.export.build.FMI_VERSION`.
    """

    root: Path
    folder: Path
    wanted: Mapping[str, str] = field(default_factory=dict)
    flavour: str = DEFAULT_FLAVOUR

    def find(self, fmu: str) -> FmuDescription:
        """An FMU by its hash if one is wanted, else by catalogue name or path."""
        if fmu in self.wanted:
            for path in sorted(self.root.rglob("*.fmu")):
                if hashlib.sha256(path.read_bytes()).hexdigest() == self.wanted[fmu]:
                    return describe_fmu(path)
        if fmu in CATALOGUE:
            try:
                return describe_fmu(ensure_fmu(fmu, self.root, flavour=self.flavour).path)
            except OSError as error:
                raise InputError(
                    f"the FMU {fmu} cannot be built",
                    where=str(self.root),
                    expected="a folder that can be written",
                    got=str(error),
                    hint="another folder: --fmus",
                ) from error
        if not fmu.endswith(".fmu"):
            raise InputError.unknown("FMU", fmu, CATALOGUE, where="components")
        path = Path(fmu)
        return describe_fmu(path if path.is_absolute() else self.folder / path)
