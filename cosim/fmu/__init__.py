"""FMUs from the outside: describe, load, call."""

from cosim.fmu.description import FmuDescription, Port, describe_fmu
from cosim.fmu.slave import Bundle, FmuSlave

__all__ = ["Bundle", "FmuDescription", "FmuSlave", "Port", "describe_fmu"]
