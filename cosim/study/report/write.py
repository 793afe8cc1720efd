"""Write the page about a study."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.page import render_page, write_page
from cosim.study.folder import MANIFEST, RESULTS, read_rows
from cosim.study.report.content import StudyContent, content_of, figures, thinned
from cosim.study.report.provenance import provenance_of
from cosim.study.report.worst_runs import COUNTS
from cosim.study.table import read_table

REPORT = "report.html"


@dataclass(frozen=True)
class StudyReport:
    """A page about a study that was written.

    Attributes
    ----------
    study : the folder, or the table, that was read.
    output, bytes : the file and its size.
    runs, count : number of runs in the table, and in the study (at most, if it may stop earlier).
    complete : whether the study is finished.
    statuses : status -> number of runs.
    unread : lines of the run log that could not be read: their runs are not on the page.
    metrics, charts : number of metrics and of charts.
    """

    study: Path
    output: Path
    bytes: int
    title: str
    runs: int
    count: int
    complete: bool
    statuses: dict[str, int]
    unread: int
    metrics: int
    charts: int

    def to_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return {
            "study": str(self.study),
            "output": str(self.output),
            "bytes": self.bytes,
            "title": self.title,
            "runs": self.runs,
            "count": self.count,
            "complete": self.complete,
            "statuses": self.statuses,
            "unread": self.unread,
            "metrics": self.metrics,
            "charts": self.charts,
        }


def write_study_report(
    study: str | Path, output: Path | None = None, *, confidence: float = 0.95
) -> StudyReport:
    """Write the page about a study, finished or not, as one HTML file that loads nothing.

    Parameters
    ----------
    study : folder of the study, or its results.parquet.
    output : the HTML file; report.html in the folder if None.
    confidence : level of the intervals.

    Raises
    ------
    InputError : not a study, pyarrow or plotly is missing, or the page cannot be written.
    """
    path = Path(study)
    table, manifest = read_table(path)
    folder = path if (path / MANIFEST).is_file() else path.parent
    unread = 0
    if folder == path and not (path / RESULTS).exists():
        with read_rows(path) as rows:
            unread = rows.unread
    target = folder / REPORT if output is None else output
    content = content_of(table, manifest, folder, target, unread=unread, confidence=confidence)
    html = study_page(content)
    sources = [path, *(folder / name for name in (MANIFEST, RESULTS))]
    return StudyReport(
        study=path,
        output=target,
        bytes=write_page(target, html, "study", sources),
        title=content.columns.study.title,
        runs=content.runs,
        count=content.count,
        complete=content.complete,
        statuses={one.status: one.found.count for one in content.statuses},
        unread=unread,
        metrics=len(content.metrics),
        charts=len(content.charts),
    )


def study_page(content: StudyContent) -> str:
    """Return the page as text, the same for the same content; `InputError` without plotly."""
    return render_page(
        "cosim.study.report",
        "study.html.j2",
        ("study.js",),
        lambda _: figures(content),
        c=content,
        study=content.columns.study,
        drawn_points=len(thinned(content.columns)),
        worst_counts=COUNTS,
        status_names=[f"status = {one.status}" for one in content.statuses],
        provenance=provenance_of(content.manifest),
    )
