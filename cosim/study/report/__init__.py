"""Report a study as one HTML file: how its runs ended, its metrics, what they depend on."""

from cosim.study.report.write import StudyReport, write_study_report

__all__ = ["StudyReport", "write_study_report"]
