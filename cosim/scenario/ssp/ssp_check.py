"""Check an SSP archive: whether it can be imported, and what other tools do not carry out."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from cosim.scenario.ssp.importing import import_ssp


@dataclass(frozen=True)
class SspCheck:
    """What an archive has, and what of it is for this project alone.

    Attributes
    ----------
    version : of SSP.
    components : names of the elements that an import has as components.
    links : that an import has.
    only_here : sentences about what other tools ignore.
    notes : deviations from the standard, and what an import leaves out or changes.
    """

    path: Path
    version: str
    components: tuple[str, ...]
    connections: int
    links: tuple[str, ...]
    only_here: tuple[str, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """Return what `cosim ssp check --json` prints."""
        return {
            "ssp": str(self.path),
            "version": self.version,
            "components": list(self.components),
            "connections": self.connections,
            "links": list(self.links),
            "only_here": list(self.only_here),
            "notes": list(self.notes),
        }


def check_ssp(ssp: Path) -> SspCheck:
    """Import an archive, leave nothing behind, and say what other tools do not carry out.

    Raises
    ------
    InputError : not an SSP archive, or one that cannot be imported.
    """
    with tempfile.TemporaryDirectory(prefix="ssp-") as folder:
        imported = import_ssp(ssp, Path(folder) / f"{ssp.stem}.toml")
    return SspCheck(
        path=ssp,
        version=imported.version,
        components=tuple(imported.names),
        connections=imported.connections,
        links=imported.links,
        only_here=imported.only_here,
        notes=imported.unsupported,
    )
