"""Traces: MCAP files of runs; write, read, describe, hash."""

from cosim.trace.layout import (
    DROPPED_SIGNALS,
    Signal,
    dropped_topic,
    input_topic,
    link_topic,
    output_topic,
    result_of_link,
)
from cosim.trace.writer import Attachment, TraceWriter

__all__ = [
    "DROPPED_SIGNALS",
    "Attachment",
    "Signal",
    "TraceWriter",
    "dropped_topic",
    "input_topic",
    "link_topic",
    "output_topic",
    "result_of_link",
]
