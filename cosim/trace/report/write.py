"""From a trace to the file of its report."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosim.core import InputError
from cosim.trace.report.content import content_of
from cosim.trace.report.html_page import page
from cosim.trace.report.verdict import Check


@dataclass(frozen=True)
class Report:
    """A report that was written.

    Attributes
    ----------
    output, bytes : the file and its size.
    status, guarantee : how the run ended, and whether its guarantee may be claimed (None: there
        is none).
    """

    trace: Path
    output: Path
    bytes: int
    status: str
    guarantee: Check | None
    assertions: tuple[Check, ...]
    charts: int

    def to_json(self) -> dict[str, Any]:
        """Everything, for `--json`."""
        return {
            "trace": str(self.trace),
            "output": str(self.output),
            "bytes": self.bytes,
            "status": self.status,
            "guarantee": None
            if self.guarantee is None
            else {"claimed": self.guarantee.tone == "good", **_words(self.guarantee)},
            "assertions": [asdict(check) for check in self.assertions],
            "charts": self.charts,
        }


def write_report(trace: Path, output: Path | None = None) -> Report:
    """Write the report of a trace, beside it unless told where.

    Parameters
    ----------
    trace : finished or not, ours or any MCAP file.
    output : run.mcap gives run.html if None.

    Raises
    ------
    InputError : not an MCAP file, plotly is missing, or the page cannot be written.
    """
    content = content_of(trace)
    target = default_output(trace) if output is None else output
    text = page(content).encode()
    if target.exists() and target.samefile(trace):
        raise InputError(
            "the report would replace its trace", where=str(target), hint="another place: --out"
        )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text)
    except (OSError, ValueError) as error:
        raise InputError(
            "the report cannot be written", where=str(target), got=str(error)
        ) from error
    return Report(
        trace=trace,
        output=target,
        bytes=len(text),
        status=content.status.what,
        guarantee=content.guarantee,
        assertions=tuple(content.assertions),
        charts=len(content.charts) + (2 if content.path else 0),
    )


def default_output(trace: Path) -> Path:
    """Where a report goes that is not told: run.html, run.partial.html."""
    name = trace.name
    for end in (".mcap", ".mcap.partial"):
        if name.endswith(end) and name != end:
            return trace.with_name(name.removesuffix(end) + end.removeprefix(".mcap") + ".html")
    return trace.with_name(f"{name}.html")


def _words(check: Check) -> dict[str, str]:
    return {"what": check.what, "why": check.why}
