"""Is a trace what it says: whole, unchanged, complete, and a run that could have happened."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosim.trace.check_results import Check, Verdict
from cosim.trace.pieces import McapFile
from cosim.trace.scan import scan
from cosim.trace.verify_file import checks_of_file
from cosim.trace.verify_run import checks_of_run


@dataclass(frozen=True)
class Verification:
    """What a file was found to be.

    Attributes
    ----------
    path : the file.
    ours : whether it records one of our runs; of other files only the structure is checked.
    checks : in the order in which they were made.
    """

    path: Path
    ours: bool
    checks: tuple[Check, ...]

    @property
    def verdict(self) -> Verdict:
        """Of all together."""
        found = {check.verdict for check in self.checks}
        if "failed" in found:
            return "failed"
        return "incomplete" if "incomplete" in found else "ok"

    def to_json(self) -> dict[str, Any]:
        """Everything, for `--json`."""
        return {
            "path": str(self.path),
            "verdict": self.verdict,
            "ok": self.verdict == "ok",
            "ours": self.ours,
            "checks": [asdict(check) for check in self.checks],
        }


def verify(path: Path, fmus: Path | None = None) -> Verification:
    """Check a file against itself, and a run's trace against what a run is.

    Parameters
    ----------
    fmus : folder in which the FMUs named are looked up by their SHA-256.

    Raises
    ------
    InputError : it cannot be read, or is no MCAP file; there is no such folder.
    """
    with McapFile(path) as file:
        found = scan(file)
        checks = list(checks_of_file(file, found))
        run = checks_of_run(file, found, path, fmus)
    if run is None:
        nothing = "no record cosim.run: of another tool's file only the structure is checked"
        checks.append(Check("run", "not checked", nothing))
        return Verification(path, ours=False, checks=tuple(checks))
    return Verification(path, ours=True, checks=(*checks, *run))
