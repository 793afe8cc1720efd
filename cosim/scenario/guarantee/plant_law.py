"""The equations of a plant of ours, as `step_law` compares them with the rows of a run."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.fmu.export import component_module
from cosim.master import ComponentInstance
from cosim.models import VehicleEquations
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.first_departure import departed
from cosim.scenario.guarantee.step_law import ArrayFunctions, Equation, step_law
from cosim.scenario.measure import Fold, MeasuredRun, measure

Reals = NDArray[np.float64]

_LINEAR = component_module("delayed_plant.variables")
_VEHICLE = component_module("vehicle_plant.variables")


@measure
def plant_law(
    run: MeasuredRun, problem: Problem, plant: str, unrecorded: Collection[str] = ()
) -> Fold[list[Departure]]:
    """Measure where the plant of a design left its law for the first time; empty if it never did.

    Parameters
    ----------
    plant : name of the component.
    unrecorded : inputs that events set, and that no connection leads to.
    """
    instance = run.instances[plant]
    bound = _bound(problem, instance, unrecorded)
    if bound is None:
        words = "a step of the plant of the design", "a plant that the design does not know"
        return departed(instance, "", *words)
    equation, names = bound
    reader = run.reader(plant, names)
    return (yield from step_law(instance, equation, reader.at_own))


def _bound(
    problem: Problem, instance: ComponentInstance, unrecorded: Collection[str]
) -> tuple[Equation, Sequence[str]] | None:
    """Return the equation of a plant, and the names of x and u; None if they are not known."""
    behaviour, step = _behaviour(problem, instance)
    if behaviour is None:
        return None
    ports = instance.component.description.ports
    if not all(n in ports for n in (*behaviour.states, *behaviour.inputs, *behaviour.delays)):
        return None
    values = {name: instance.component.start_of(name, 0.0) for name in ports}
    try:
        constants = behaviour.constants(values)
    except (ArithmeticError, KeyError, TypeError, ValueError):
        return None
    delays = tuple(float(values[name]) for name in behaviour.delays)
    unknown = tuple(j for j, name in enumerate(behaviour.inputs) if name in unrecorded)

    def rates(t: Reals, x: Sequence[Reals], *past_and_u: Sequence[Any]) -> Sequence[Any]:
        found: Sequence[Any] = behaviour.rates(t, x, *past_and_u, constants, ArrayFunctions)
        return found

    equation = Equation(tuple(behaviour.states), rates, delays, step, unknown)
    return equation, [*behaviour.states, *behaviour.inputs]


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
