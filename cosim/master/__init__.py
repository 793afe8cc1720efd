"""The co-simulation master: system, wiring, loop, recorder."""

from cosim.master.engine import EngineChoice, EngineName
from cosim.master.journal import Observer
from cosim.master.loop import simulate
from cosim.master.recorder import TraceRecorder
from cosim.master.run import Run
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
    "EngineChoice",
    "EngineName",
    "Link",
    "Observer",
    "Run",
    "System",
    "Timetable",
    "TraceRecorder",
    "make_timetable",
    "simulate",
]
