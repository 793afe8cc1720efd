"""The loop that a design is about: what every input of plant, controller and sensors reads.

A certificate is about one plant and one controller, connected as Eq. (7) and Eq. (8) say:

    controller.x[j]        reads  plant.x[j]                  state feedback, over one link
    controller.NAME[i]     reads  a sensor's y[k]             an observer, with its stamp
    sensor.u[k]            reads  (C x)[i], C of the measurement, from the plant at once
    plant.u[i]             reads  controller.u[i]             commands, over one link

States and controls have the names that the note of the plant gives them (`DesignedPlant`), those
of the vehicle, or those of Eq. (7). Nothing else may feed these inputs, and no disturbance or
set-point may depend on the loop: it would be feedback that no proof knows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cosim import hinf
from cosim.fmu import FmuDescription
from cosim.models import STATE
from cosim.scenario.gain import Problem, observes
from cosim.scenario.performance import DISTURBANCES, FORCES, elements, equation_names

if TYPE_CHECKING:
    from cosim.hinf import Result

Form = Mapping[str, float]
"""A linear combination of the plant's outputs: coefficient by variable."""


@dataclass(frozen=True)
class DesignedMeasurement:
    """A measurement of an observer: inputs of the controller, and what they are of the plant.

    Attributes
    ----------
    inputs : variables of the controller, one per value.
    stamp : variable of the controller.
    forms : what each value is, of the plant's outputs.
    noise : greatest size of each value's noise for which the design counts.
    """

    name: str
    inputs: tuple[str, ...]
    stamp: str
    forms: tuple[Form, ...]
    noise: tuple[float, ...]


@dataclass(frozen=True)
class DesignedLoop:
    """The loop of a design.

    Attributes
    ----------
    plant, controller : names of the components.
    states : input of the controller -> output of the plant that it is; empty for an observer.
    measurements : of an observer.
    commands : input of the plant -> output of the controller that it is.
    disturbances : inputs of the plant that are w: anything may act there but the loop itself.
    bounded : further inputs of the plant that the envelope bounds, such as a current.
    """

    plant: str
    controller: str
    states: Mapping[str, str]
    measurements: tuple[DesignedMeasurement, ...]
    commands: Mapping[str, str]
    disturbances: frozenset[str]
    bounded: frozenset[str]


def designed_loop(
    design: Result, problem: Problem, plant: str, controller: str, fmu: FmuDescription
) -> DesignedLoop:
    """Return the loop of a design, with the names of its plant's FMU.

    Parameters
    ----------
    plant, controller : names of the components.
    fmu : of the plant.
    """
    note = problem.plant
    n = len(problem.system.A) - problem.system.integrals
    rows = np.eye(n)
    states, commands, acting = equation_names(problem.system, n)
    if note is not None:
        states, commands, acting = (x.names for x in (note.state, note.control, note.disturbance))
        rows = np.eye(len(states)) if note.state.map is None else note.state.map
    elif all(name in fmu.ports for name in (*STATE, *FORCES)):
        states, commands, acting = STATE, FORCES, DISTURBANCES
    envelope = {} if note is None else note.envelope
    return DesignedLoop(
        plant,
        controller,
        {} if observes(design) else _states_fed_back(problem, states),
        tuple(_measurements(design, states, rows)) if observes(design) else (),
        {name: name for name in commands},
        frozenset(acting),
        frozenset(name for name in envelope if name in fmu.ports) - set(states),
    )


def set_point_of(state: str) -> str:
    """Return the input of a controller that is the set-point of a position; empty of others."""
    return state.replace("eta.", "reference.", 1) if state.startswith("eta.") else ""


def _states_fed_back(problem: Problem, states: tuple[str, ...]) -> dict[str, str]:
    """Return the states that the controller is told; integrals are states of its own."""
    measured = problem.system.measured[: len(states)]
    return {name: name for name, own in zip(states, measured, strict=True) if own}


def _measurements(
    design: hinf.Result, states: tuple[str, ...], rows: np.ndarray
) -> list[DesignedMeasurement]:
    found = []
    for one in design.measurements:
        forms = [
            {name: float(x) for name, x in zip(states, row, strict=True) if x}
            for row in one.C @ rows
        ]
        inputs = elements(one.name, len(one.C))
        found.append(
            DesignedMeasurement(one.name, inputs, f"stamp.{one.name}", tuple(forms), one.noise)
        )
    return found
