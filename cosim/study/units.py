"""Units of the axes and metrics of a study, where the FMUs or the scenario's keys have one."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.fmu import FmuDescription
from cosim.scenario import split
from cosim.study.schema import Axis, Metric, Study

_SECONDS = frozenset({"delay", "offset", "sample_time", "end", "step", "loop_delay"})
"""Last keys of places in a scenario that are times."""
_SUFFIXES = {"_s": "s", "_m": "m"}
"""Ends of the names of a run's figures that say their unit."""
_OF_REDUCTIONS = {"settling_time": "s", "growth_rate": "1/s"}


def units_of(study: Study, fmus: Mapping[str, FmuDescription]) -> dict[str, str]:
    """Return the units of the axes and metrics that have one, by name.

    `fmus` : of the components that are the same in every run, by component.
    """
    found = {axis.column: _of_axis(axis, fmus) for axis in study.vary}
    found |= {name: _of_metric(metric, fmus) for name, metric in study.metrics.items()}
    return {name: unit for name, unit in found.items() if unit}


def _of_axis(axis: Axis, fmus: Mapping[str, FmuDescription]) -> str:
    if axis.apply:  # its values are those of expressions
        return ""
    return _common([_of_place(place, fmus) for place in axis.places])


def _of_place(place: str, fmus: Mapping[str, FmuDescription]) -> str:
    match split(place):
        case ("components", str(component), "parameters", str(name)):
            return _of_variable(f"{component}.{name}", fmus)
        case (*_, str(key)) if key in _SECONDS:
            return "s"
    return ""


def _of_metric(metric: Metric, fmus: Mapping[str, FmuDescription]) -> str:
    if metric.asks or metric.value is not None:
        return ""
    if metric.reduce is not None:
        own = _common([_of_variable(signal, fmus) for signal in metric.signals])
        return _OF_REDUCTIONS.get(metric.reduce, own)
    path = str(metric.path)
    if path.startswith("final."):
        return _of_variable(path.removeprefix("final."), fmus)
    return next((unit for end, unit in _SUFFIXES.items() if path.endswith(end)), "")


def _of_variable(signal: str, fmus: Mapping[str, FmuDescription]) -> str:
    component, _, name = signal.partition(".")
    port = fmus[component].ports.get(name) if component in fmus else None
    return "" if port is None else port.unit or ""


def _common(units: list[str]) -> str:
    return units[0] if len(set(units)) == 1 else ""
