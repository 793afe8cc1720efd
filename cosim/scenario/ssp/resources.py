"""FMUs of an archive, each once."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

from cosim.fmu import ComponentSpec, build_fmu


class Resources:
    """Files below resources/ by their path in the archive."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self._of: dict[str, str] = {}

    def add(self, stem: str, content: bytes) -> str:
        """Path of an FMU; one that is there already is not added again."""
        digest = hashlib.sha256(content).hexdigest()
        if digest not in self._of:
            path, number = f"resources/{stem}.fmu", 2
            while path in self.files:
                path, number = f"resources/{stem}_{number}.fmu", number + 1
            self.files[path] = content
            self._of[digest] = path
        return self._of[digest]

    def build(self, spec: ComponentSpec) -> str:
        """Path of an FMU that is made for this archive, native and for this machine.

        Raises
        ------
        InputError : no compiler.
        """
        with tempfile.TemporaryDirectory(prefix="cosim-ssp-") as folder:
            return self.add(spec.name, build_fmu(spec, Path(folder), "native").read_bytes())
