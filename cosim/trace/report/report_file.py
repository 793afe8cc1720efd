"""Write the report of a trace, or of two side by side, as an HTML file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cosim.page import write_page
from cosim.trace.comparison.format import diff_verdict
from cosim.trace.outcome.verdict import Statement
from cosim.trace.report.comparison import comparison_of
from cosim.trace.report.html_page import comparison_page, page
from cosim.trace.report.page_content import content_of


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
    guarantee: Statement | None
    assertions: tuple[Statement, ...]
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
    return Report(
        trace=trace,
        output=target,
        bytes=write_page(target, page(content), "trace", (trace,)),
        status=content.status.what,
        guarantee=content.guarantee,
        assertions=tuple(content.assertions),
        charts=len(content.charts) + (2 if content.path else 0),
    )


@dataclass(frozen=True)
class ComparisonReport:
    """A page of two traces that was written.

    Attributes
    ----------
    traces : the first and the second.
    output, bytes : the file and its size.
    statuses : how each run ended.
    equal : whether signals, messages of links and end agree; verdict : the same in words.
    differing : number of signals that differ.
    """

    traces: tuple[Path, Path]
    output: Path
    bytes: int
    statuses: tuple[str, str]
    equal: bool
    verdict: str
    differing: int
    charts: int

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json`."""
        return {
            "traces": [str(path) for path in self.traces],
            "output": str(self.output),
            "bytes": self.bytes,
            "statuses": list(self.statuses),
            "equal": self.equal,
            "verdict": self.verdict,
            "differing": self.differing,
            "charts": self.charts,
        }


def write_comparison(a: Path, b: Path, output: Path | None = None) -> ComparisonReport:
    """Write a page of two traces, side by side, as one HTML file.

    Parameters
    ----------
    a, b : traces of runs, or any MCAP files.
    output : the HTML file; beside the first if None, a-b.html for a.mcap and b.mcap.

    Raises
    ------
    InputError : not an MCAP file, plotly is missing, or the page cannot be written.
    LossError : a trace is damaged.
    """
    found = comparison_of(a, b)
    own = default_output(a)
    other = default_output(b).name
    target = own.with_name(f"{own.stem}-{other}") if output is None else output
    return ComparisonReport(
        traces=(a, b),
        output=target,
        bytes=write_page(target, comparison_page(found), "trace", (a, b)),
        statuses=(found.a.status.what, found.b.status.what),
        equal=found.found.equal,
        verdict=diff_verdict(found.found),
        differing=len(found.parted),
        charts=len(found.charts) + (2 if found.a.path or found.b.path else 0),
    )


def default_output(trace: Path) -> Path:
    """Return where a report goes by default: run.html, run.partial.html."""
    name = trace.name
    for end in (".mcap", ".mcap.partial"):
        if name.endswith(end) and name != end:
            return trace.with_name(name.removesuffix(end) + end.removeprefix(".mcap") + ".html")
    return trace.with_name(f"{name}.html")
