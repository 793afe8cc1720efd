"""The co-simulation master: system, wiring, loop, recorder."""

from cosim.master.engine import EngineChoice, EngineName
from cosim.master.journal import Observer
from cosim.master.pacing import Pace
from cosim.master.recorder import TraceRecorder, identifier
from cosim.master.run import Run
from cosim.master.session import Session
from cosim.master.simulate import simulate
from cosim.master.snapshot import Snapshot
from cosim.master.system import (
    Algorithm,
    Component,
    Connection,
    DelaySource,
    Endpoint,
    LogLevel,
    Policy,
    System,
)
from cosim.master.timetable import Link, Timetable, make_timetable

__all__ = [
    "Algorithm",
    "Component",
    "Connection",
    "DelaySource",
    "Endpoint",
    "EngineChoice",
    "EngineName",
    "Link",
    "LogLevel",
    "Observer",
    "Pace",
    "Policy",
    "Run",
    "Session",
    "Snapshot",
    "System",
    "Timetable",
    "TraceRecorder",
    "identifier",
    "make_timetable",
    "simulate",
]
