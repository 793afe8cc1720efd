"""FMUs from the outside: describe, load, call."""

from cosim.fmu.description import FmuDescription, describe_fmu
from cosim.fmu.messages import LogSink
from cosim.fmu.port import Port, SignalKind
from cosim.fmu.slave import FmuSlave, StepResults
from cosim.fmu.state import State

__all__ = [
    "FmuDescription",
    "FmuSlave",
    "LogSink",
    "Port",
    "SignalKind",
    "State",
    "StepResults",
    "describe_fmu",
]
