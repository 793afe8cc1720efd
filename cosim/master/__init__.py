"""The co-simulation master: system, wiring, loop, recorder."""

from cosim.master.loop import Observer, Run, simulate
from cosim.master.recorder import TraceRecorder
from cosim.master.system import (
    Component,
    Connection,
    Endpoint,
    Link,
    System,
    Timetable,
    make_timetable,
)

__all__ = [
    "Component",
    "Connection",
    "Endpoint",
    "Link",
    "Observer",
    "Run",
    "System",
    "Timetable",
    "TraceRecorder",
    "make_timetable",
    "simulate",
]
