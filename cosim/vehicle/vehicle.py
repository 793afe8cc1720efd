"""A vehicle as its file describes it: states, actuators, parameters, equations, sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

from cosim.fmu.export import ComponentSpec, component_module
from cosim.models import FloatFunctions, VehicleEquations
from cosim.vehicle.parameters import Parameter


@dataclass(frozen=True)
class Actuator:
    """A thruster or a fin.

    Attributes
    ----------
    name, kind : of the vehicle file; its command is `thruster.NAME` or `fin.NAME`.
    limit : largest command in both directions, in `unit`.
    lag : time constant behind the command [s]; 0: at once, and `actual.NAME` is no state.
    unit : "N", "N.m" of a moment alone, "rad" of a fin.
    """

    name: str
    kind: Literal["thruster", "fin"]
    limit: float
    lag: float
    unit: str

    @property
    def command(self) -> str:
        """FMI name of its input."""
        return f"{self.kind}.{self.name}"


@dataclass(frozen=True)
class OnboardDamping:
    """The damping loop on board: rates [1/s] by velocity ("u", ...), age of its data [s]."""

    rates: Mapping[str, float]
    delay: float


@dataclass(frozen=True)
class Sensor:
    """What is measured.

    Attributes
    ----------
    measures : outputs of the plant, such as "eta.x".
    interval : time from one measurement to the next [s]; 0: at every communication point.
    noise : standard deviation of each value, in its unit.
    age : greatest age of the values when they act [s].
    over : "onboard", or "link" for what comes from outside.
    """

    name: str
    measures: tuple[str, ...]
    interval: float
    noise: tuple[float, ...]
    age: float
    over: Literal["onboard", "link"]


@dataclass(frozen=True)
class Control:
    """What the design controls.

    Attributes
    ----------
    states : controlled states; where the file says none, those that actuators move and sensors
        show, roll and pitch only where nothing else holds them (`cosim.vehicle.defaults`).
    weights : in z, by state or by command of an actuator; those that the file gives.
    """

    states: tuple[str, ...]
    weights: Mapping[str, float]


@dataclass(frozen=True)
class Vehicle:
    """A vehicle.

        >>> from cosim.vehicle import load_vehicle
        >>> vehicle = load_vehicle("remus100")
        >>> vehicle.degrees_of_freedom, [actuator.name for actuator in vehicle.actuators]
        (6, ['propeller', 'rudder', 'stern'])
        >>> vehicle.trim["nu.u"], vehicle.envelope["eta.theta"], "mass" in vehicle.parameters
        (1.5, 0.15, True)

    Attributes
    ----------
    degrees_of_freedom : 4 or 6.
    attitude : "euler", or "quaternion" with 6.
    actuators : thrusters, then fins.
    parameter_table : parameters of the plant with units; `parameters` has name -> value.
    terms : which terms the equations have (`cosim.models.VehicleEquations`).
    damping : the onboard loop; None without one.
    trim : velocity through the water by FMI name; those that are absent are zero.
    envelope : state by FMI name -> bound about the trim, for every angle and velocity.
    default_bounds : the states whose bound is a default, since the file gives none.
    text : the file.
    defaults : by its place in the file, each value that the file leaves open, and the default used.
    """

    name: str
    description: str
    source: str
    degrees_of_freedom: Literal[4, 6]
    attitude: Literal["euler", "quaternion"]
    actuators: tuple[Actuator, ...]
    parameter_table: tuple[Parameter, ...]
    terms: Mapping[str, Any]
    damping: OnboardDamping | None
    sensors: tuple[Sensor, ...]
    trim: Mapping[str, float]
    envelope: Mapping[str, float]
    default_bounds: tuple[str, ...]
    control: Control
    text: str = field(repr=False)
    defaults: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def equations(self) -> VehicleEquations:
        """The equations, for given parameters and any kind of scalar."""
        return VehicleEquations(self.terms)

    @property
    def states(self) -> tuple[str, ...]:
        """FMI names of the state: eta (or its quaternion), nu, `actual.NAME`."""
        return self.equations.states

    @property
    def velocities(self) -> tuple[str, ...]:
        """FMI names of nu."""
        return tuple(name for name in self.states if name.startswith("nu."))

    @property
    def inputs(self) -> tuple[str, ...]:
        """FMI names of the inputs: commands, current.x/.y/.z, disturbance.u ... .r."""
        return self.equations.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """FMI names of the outputs: the states, and the Euler angles beside a quaternion."""
        return output_names(self.states, self.attitude)

    @cached_property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of the plant by FMI name."""
        return MappingProxyType({p.name: p.value for p in self.parameter_table})

    def rates(
        self,
        x: Sequence[Any],
        delayed: Sequence[Any],
        u: Sequence[Any],
        ns: Any = FloatFunctions,
        parameters: Mapping[str, Any] | None = None,
    ) -> list[Any]:
        """Return x' (n,).

        Parameters
        ----------
        x : in the order of `states` (n,).
        delayed : x(t-d) (n,), or nothing without onboard damping.
        u : in the order of `inputs` (m,).
        ns : the functions sin, cos, sqrt, exp, atan2, asin, and min and max of two, for these
            scalars.
        parameters : values in place of the vehicle's own, by the same names.
        """
        constants = (
            self._constants if parameters is None else self.equations.constants(parameters, ns)
        )
        return self.equations.rates(x, delayed, u, constants, ns)

    def fmu_spec(self, name: str) -> ComponentSpec:
        """Specify the plant FMU, for `cosim.pack` and `cosim.build_fmu`; `name` : of the model."""
        spec: ComponentSpec = component_module("vehicle_plant.variables").vehicle_plant_spec(
            self, name=name
        )
        return spec

    @cached_property
    def _constants(self) -> Mapping[str, Any]:
        """What the equations make of the vehicle's own parameters, such as the mass's inverse."""
        return self.equations.constants(self.parameters, FloatFunctions)


def output_names(states: Sequence[str], attitude: str) -> tuple[str, ...]:
    """Return the names of the outputs of a vehicle with these states."""
    angles = ("eta.phi", "eta.theta", "eta.psi") if attitude == "quaternion" else ()
    return (*states, *angles)
