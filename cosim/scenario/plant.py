"""Compare the parameters of a run's plant with the system of its design."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from cosim import hinf
from cosim.fmu import component_module
from cosim.models import TABLE_1, DelaySystem

_PLANT = component_module("delayed_plant.variables")
_ENTRY = re.compile(r"(?:[AH][0-9]*|[BCE]|D[12]?)\[[0-9]+,[0-9]+\]")


def is_vehicle_of(
    design: hinf.AuvDesignSettings, parameters: Mapping[str, float | None], *, exact: bool = False
) -> bool:
    """Whether these parameters are those of the vehicle in the design; `exact`: the delay too."""
    wanted = {name: design.parameters[name] for name in TABLE_1}
    wanted |= {f"damping.{axis}": a for axis, a in zip("uvwr", design.damping, strict=True)}
    return all(parameters.get(name) == value for name, value in wanted.items()) and _covered(
        parameters, {"delay.d": design.state_delay}, exact=exact
    )


def is_plant_of(
    system: DelaySystem, parameters: Mapping[str, float | None], *, exact: bool = False
) -> bool:
    """Whether these parameters are the matrices and delays of a system, named as in Eq. (7).

    A delay may be shorter than the system's, unless the proof is about `exact` ones.
    Matrices that the system does not have may be present if they are zero.
    """
    wanted = {
        f"{letter}[{i + 1},{j + 1}]": float(value)
        for letter, matrix in _PLANT.plant_matrices(system).items()
        for (i, j), value in np.ndenumerate(matrix)
    }
    # an entry that the plant lacks is None here, hence unequal
    found = {
        name: parameters.get(name) for name in (*wanted, *filter(_ENTRY.fullmatch, parameters))
    }
    delays = _PLANT.plant_delays(system)
    named = zip(_PLANT.delay_names(len(delays)), (delay.d for delay in delays), strict=True)
    return all(value == wanted.get(name, 0.0) for name, value in found.items()) and _covered(
        parameters, dict(named), exact=exact
    )


def _covered(
    parameters: Mapping[str, float | None], delays: Mapping[str, float], *, exact: bool
) -> bool:
    """Whether the proof covers every delay: the same, or a shorter one where it is not `exact`."""
    found = [(parameters.get(name), d) for name, d in delays.items()]
    return all(v is not None and (v == d if exact else v <= d) for v, d in found)
