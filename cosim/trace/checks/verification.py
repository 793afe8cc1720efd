"""Verify a trace: whole, unchanged, complete, and consistent as a run."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosim.core import AnyPath
from cosim.trace.checks.of_file import FileChecks
from cosim.trace.checks.of_run import checks_of_run
from cosim.trace.checks.results import CheckResult, Verdict
from cosim.trace.file.walk import Walk


@dataclass(frozen=True)
class Verification:
    """The result of verifying a file.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import verify
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> verification = verify("lag.mcap")
        >>> verification.verdict, verification.ours, verification.checks[0].name
        ('ok', True, 'end of file')

    Attributes
    ----------
    path : the file.
    ours : whether it records a run of auv-cosim; of other files only the structure is checked.
    checks : in the order in which they were made.
    """

    path: Path
    ours: bool
    checks: tuple[CheckResult, ...]

    @property
    def verdict(self) -> Verdict:
        """The verdict of all checks together."""
        found = {check.verdict for check in self.checks}
        if "failed" in found:
            return "failed"
        return "incomplete" if "incomplete" in found else "ok"

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json`."""
        return {
            "path": str(self.path),
            "verdict": self.verdict,
            "ok": self.verdict == "ok",
            "ours": self.ours,
            "checks": [asdict(check) for check in self.checks],
        }


def verify(path: AnyPath, fmus: AnyPath | None = None) -> Verification:
    """Check the structure of a file, and the content of a run's trace for consistency.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import verify
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> verify("lag.mcap").verdict
        'ok'
        >>> [check.name for check in verify("lag.mcap").checks if check.verdict == "failed"]
        []

    Parameters
    ----------
    fmus : folder in which to look up the trace's FMUs by their SHA-256.

    Raises
    ------
    InputError : the file cannot be read, or is no MCAP file; there is no such folder.
    """
    path = Path(path)
    walk = Walk(path, "skip")
    found = FileChecks(walk)
    for record in walk:
        found.add(record)
    return verification_of(path, walk, found, None if fmus is None else Path(fmus))


def verification_of(
    path: Path, walk: Walk, found: FileChecks, fmus: Path | None = None
) -> Verification:
    """Return the checks of a file, after the walk over it, and those of a run; see `verify`."""
    checks = list(found.results)
    run = checks_of_run(walk, found, path, fmus)
    nothing = "no record cosim.run: of another tool's file only the structure is checked"
    checks += [CheckResult("run", "not checked", nothing)] if run is None else run
    return Verification(path, ours=run is not None, checks=tuple(checks))
