"""Write the report of a trace as an HTML file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosim.core import InputError, write_whole
from cosim.trace.report.content import content_of
from cosim.trace.report.html_page import page
from cosim.trace.verdict import Check


@dataclass(frozen=True)
class Report:
    """A report that was written.

    Attributes
    ----------
    output, bytes : the file and its size.
    status : how the run ended.
    guarantee : whether the certified bound may be claimed; None if nothing was certified.
    """

    trace: Path
    output: Path
    bytes: int
    status: str
    guarantee: Check | None
    assertions: tuple[Check, ...]
    charts: int

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json`."""
        claim = self.guarantee
        return {
            "trace": str(self.trace),
            "output": str(self.output),
            "bytes": self.bytes,
            "status": self.status,
            "guarantee": claim
            and {"claimed": claim.tone == "good", "what": claim.what, "why": claim.why},
            "assertions": [asdict(check) for check in self.assertions],
            "charts": self.charts,
        }


def write_report(trace: Path, output: Path | None = None) -> Report:
    """Write the report of a trace as one HTML file.

    Parameters
    ----------
    trace : a trace, finished or not, or any MCAP file.
    output : the HTML file; beside the trace if None, run.html for run.mcap.

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
        write_whole(target, text)
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
    """Return where a report goes by default: run.html, run.partial.html."""
    name = trace.name
    for end in (".mcap", ".mcap.partial"):
        if name.endswith(end) and name != end:
            return trace.with_name(name.removesuffix(end) + end.removeprefix(".mcap") + ".html")
    return trace.with_name(f"{name}.html")
