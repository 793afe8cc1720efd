"""Where a slave stands in its life, and what may be set there."""

from __future__ import annotations

from typing import Literal

from cosim.fmu.port import Port

Phase = Literal["instantiated", "initialising", "stepping", "failed", "closed"]

PHASE_TEXT = {
    "instantiated": "before the initialisation",
    "initialising": "during the initialisation",
    "stepping": "after the initialisation",
}


def may_be_set(port: Port, phase: Phase) -> bool:
    """Whether the standard lets a variable be set in a phase (FMI 2.0.4 4.2.4, FMI 3.0 2.3.1).

    Structural parameters have a mode of their own, which is passed before the initialisation.
    """
    if port.variability == "constant" or port.causality == "independent":
        return False
    if phase == "instantiated":
        return port.initial in ("exact", "approx") or port.causality == "input"
    if port.causality == "structuralParameter":
        return False
    if phase == "initialising":
        return port.initial == "exact" or port.causality == "input"
    tunable = port.causality == "parameter" and port.variability == "tunable"
    return phase == "stepping" and (tunable or port.causality == "input")


def describe_settable(port: Port) -> str:
    """When a variable may be set, in words."""
    phases: tuple[Phase, ...] = ("instantiated", "initialising", "stepping")
    when = [PHASE_TEXT[phase] for phase in phases if may_be_set(port, phase)]
    kind = f"{port.variability} {port.causality}"
    return f"{kind}: {' and '.join(when) if when else 'never'}"
