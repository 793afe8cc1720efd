from .report_file import (
    ComparisonReport as ComparisonReport,
    Report as Report,
    write_comparison as write_comparison,
    write_report as write_report,
)
