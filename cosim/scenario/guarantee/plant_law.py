"""The equations of a plant of ours, as `StepLaw` compares them with the rows of a run."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.fmu import component_module
from cosim.master import ComponentInstance
from cosim.models import VehicleEquations
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.step_law import ArrayFunctions, Equation, ReadRows, StepLaw
from cosim.scenario.signal_reader import OwnRows

Reals = NDArray[np.float64]

_LINEAR = component_module("delayed_plant.variables")
_VEHICLE = component_module("vehicle_plant.variables")


def plant_law(problem: Problem, plant: str, unrecorded: Collection[str] = ()) -> StepLaw:
    """Return the measure of the law of the plant of a design.

    Parameters
    ----------
    plant : name of the component.
    unrecorded : inputs that events set, and that no connection leads to.
    """

    def read(instance: ComponentInstance) -> tuple[Equation, ReadRows] | None:
        behaviour, step = _behaviour(problem, instance)
        if behaviour is None:
            return None
        ports = instance.component.description.ports
        needed = (*behaviour.states, *behaviour.inputs, *behaviour.delays)
        if not all(name in ports for name in needed):
            return None
        values = {name: instance.component.start_of(name, 0.0) for name in ports}
        try:
            constants = behaviour.constants(values)
        except (ArithmeticError, KeyError, TypeError, ValueError):
            return None
        delays = tuple(float(values[name]) for name in behaviour.delays)
        unknown = tuple(j for j, name in enumerate(behaviour.inputs) if name in unrecorded)
        rates = _rates(behaviour, constants)
        equation = Equation(tuple(behaviour.states), rates, delays, step, unknown)
        return equation, OwnRows(instance, behaviour.states, behaviour.inputs).read

    return StepLaw(plant, read)


def _rates(behaviour: Any, constants: Any) -> Any:
    def rates(
        t: Reals, x: Sequence[Reals], late: Sequence[Sequence[Reals]], u: Sequence[Reals]
    ) -> Sequence[Any]:
        found: Sequence[Any] = behaviour.rates(t, x, late, u, constants, ArrayFunctions)
        return found

    return rates


_vehicles: WeakKeyDictionary[DesignedPlant, tuple[Any, float]] = WeakKeyDictionary()
"""What was made of a note before: a study flies one design many times."""


def _vehicle(note: DesignedPlant) -> tuple[Any, float]:
    """Return the behaviour of a vehicle's plant, and the step fine enough for it."""
    record = _VEHICLE.record_from_json(note.model)
    behaviour = component_module("vehicle_plant.behaviour").VehiclePlant({"terms": record.terms})
    return behaviour, _VEHICLE.default_step(record, VehicleEquations(record.terms))


def _behaviour(problem: Problem, instance: ComponentInstance) -> tuple[Any, float]:
    """Return the behaviour of the plant that a design is for, and the step fine enough for it."""
    if problem.plant is not None:
        if not problem.plant.model:
            return None, math.inf
        if problem.plant not in _vehicles:
            _vehicles[problem.plant] = _vehicle(problem.plant)
        return _vehicles[problem.plant]
    if problem.vehicle is not None:
        port = instance.component.description.ports.get("solver.step")
        step = float(port.start) if port is not None and port.start else 0.05
        return component_module("auv_plant.behaviour").AuvPlant({}), min(step, 0.05)
    system = hinf.problem.without_integrals(problem.system)
    spec = _LINEAR.delayed_plant_spec(system)
    behaviour = component_module("delayed_plant.behaviour").DelayedPlant(spec.constants)
    return behaviour, _LINEAR.default_step(_LINEAR.plant_matrices(system))
