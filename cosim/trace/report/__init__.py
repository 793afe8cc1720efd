"""Report a trace as one HTML file: verdict, path, signals, links, provenance."""

from cosim.trace.report.write import Report, write_report

__all__ = ["Report", "write_report"]
