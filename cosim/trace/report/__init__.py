"""Report a trace as one HTML file: verdict, path, signals, links; or two side by side."""

from cosim.trace.report.write_report import ComparisonReport, Report, write_comparison, write_report

__all__ = ["ComparisonReport", "Report", "write_comparison", "write_report"]
