"""Inspect any FMU without loading it: what it is, what it needs, what is wrong with it."""

from cosim.fmu.inspect.findings import Finding
from cosim.fmu.inspect.inspection import Inspection, inspect_fmu

__all__ = ["Finding", "Inspection", "inspect_fmu"]
