"""The equations of a plant of ours, as `StepLaw` compares them with the rows of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.fmu import component_module
from cosim.master import ComponentInstance
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.step_law import ArrayFunctions, Equation, StepLaw
from cosim.scenario.performance import reader_of

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
    made: list[Any] = []

    def equation(instance: ComponentInstance) -> Equation | None:
        behaviour, step = _behaviour(problem, instance)
        if behaviour is None:
            return None
        ports = instance.component.description.ports
        needed = (*behaviour.states, *behaviour.inputs, *behaviour.delays)
        if not all(name in ports for name in needed):
            return None
        made.append(behaviour)
        start_of = instance.component.start_of
        values = {name: start_of(name, 0.0) for name in ports}
        try:
            constants = behaviour.constants(values)
        except (ArithmeticError, KeyError, TypeError, ValueError):
            return None
        delays = tuple(float(values[name]) for name in behaviour.delays)
        unknown = tuple(j for j, name in enumerate(behaviour.inputs) if name in unrecorded)
        rates = _rates(behaviour, constants)
        return Equation(tuple(behaviour.states), rates, delays, step, unknown)

    def read(instance: ComponentInstance) -> Callable[[int, int], tuple[Reals, Reals]]:
        states, inputs = (reader_of(instance, x) for x in (made[0].states, made[0].inputs))
        return lambda first, last: (states.read(first, last), inputs.read(first, last))

    return StepLaw(plant, equation, read)


def _rates(behaviour: Any, constants: Any) -> Any:
    def rates(
        t: Reals, x: Sequence[Reals], late: Sequence[Sequence[Reals]], u: Sequence[Reals]
    ) -> Sequence[Any]:
        found: Sequence[Any] = behaviour.rates(t, x, late, u, constants, ArrayFunctions)
        return found

    return rates


def _behaviour(problem: Problem, instance: ComponentInstance) -> tuple[Any, float]:
    """Return the behaviour of the plant that a design is for, and the step fine enough for it."""
    if problem.plant is not None:
        if not problem.plant.model:
            return None, math.inf
        record = _VEHICLE.record_from_json(problem.plant.model)
        kind = component_module("vehicle_plant.behaviour")
        behaviour = kind.VehiclePlant({"terms": record.terms})
        return behaviour, _VEHICLE.default_step(record, behaviour._equations)  # noqa: SLF001
    if problem.vehicle is not None:
        port = instance.component.description.ports.get("solver.step")
        step = float(port.start) if port is not None and port.start else 0.05
        return component_module("auv_plant.behaviour").AuvPlant({}), min(step, 0.05)
    system = hinf.without_integrals(problem.system)
    spec = _LINEAR.delayed_plant_spec(system)
    behaviour = component_module("delayed_plant.behaviour").DelayedPlant(spec.constants)
    return behaviour, _LINEAR.default_step(_LINEAR.plant_matrices(system))
