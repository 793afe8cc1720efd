"""Traces: MCAP files of runs; write, read, describe, hash."""

from cosim.trace.assertions import AssertionResult
from cosim.trace.content import content_hash
from cosim.trace.diff import Diff, diff
from cosim.trace.info import describe
from cosim.trace.info_view import render
from cosim.trace.layout import (
    CERTIFICATE_ATTACHMENT,
    CERTIFICATE_HASH,
    DESIGN_ATTACHMENT,
    DROPPED_SIGNALS,
    SCENARIO_ATTACHMENT,
    Signal,
    certificate_entries,
    dropped_topic,
    input_topic,
    link_topic,
    output_topic,
    result_of_link,
)
from cosim.trace.reader import TopicInfo, Trace
from cosim.trace.recover import Recovery, recover
from cosim.trace.rows import Poses, Rows
from cosim.trace.table import Series, Table
from cosim.trace.tolerance import Tolerance, Tolerances
from cosim.trace.verdicts import Check
from cosim.trace.verify import Verification, verify
from cosim.trace.writer import Attachment, TraceWriter

__all__ = [
    "CERTIFICATE_ATTACHMENT",
    "CERTIFICATE_HASH",
    "DESIGN_ATTACHMENT",
    "DROPPED_SIGNALS",
    "SCENARIO_ATTACHMENT",
    "AssertionResult",
    "Attachment",
    "Check",
    "Diff",
    "Poses",
    "Recovery",
    "Rows",
    "Series",
    "Signal",
    "Table",
    "Tolerance",
    "Tolerances",
    "TopicInfo",
    "Trace",
    "TraceWriter",
    "Verification",
    "certificate_entries",
    "content_hash",
    "describe",
    "diff",
    "dropped_topic",
    "input_topic",
    "link_topic",
    "output_topic",
    "recover",
    "render",
    "result_of_link",
    "verify",
]
