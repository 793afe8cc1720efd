"""The vehicle file as data: every key with its unit and sign convention, in Fossen's notation.

SI units. Body axes: x forward, y to starboard, z down; the earth's: north, east, down. Forces and
moments are as they act on the vehicle: a damping derivative such as X_u is negative.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Field

from cosim.core import NotNegative, Number, Positive, Text
from cosim.scenario import Part

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")
_TITLE = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def _part_of_names(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError("a name: a letter, then letters and digits, with single _ between")
    return name


def _title(name: str) -> str:
    if not _TITLE.fullmatch(name):
        raise ValueError("a name: a letter, then letters, digits, _ or -")
    return name


Name = Annotated[str, AfterValidator(_part_of_names)]
"""Of an actuator or a sensor: a part of FMI names."""
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Entry = Annotated[list[Annotated[int, Field(ge=1, le=6)]], Field(min_length=2, max_length=2)]


class BodyPart(Part):
    """[body]: mass, inertia, and where weight and buoyancy act."""

    mass: Positive
    """Dry mass m, with the water inside the hull that moves with it [kg]."""
    inertia: Vector | Matrix
    """Moments of inertia [I_x, I_y, I_z], or the whole matrix (entries off the diagonal are -I_xy,
    ...), about the point that `inertia_about` names [kg m2]; in 4 degrees of freedom only I_z is
    used.
    """
    inertia_about: Literal["origin", "centre-of-gravity"] = "origin"
    """The point that `inertia` is about."""
    r_g: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Centre of gravity from the origin of the body axes, z down: stable is below r_b [m]."""
    r_b: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Centre of buoyancy from the origin of the body axes [m]."""
    weight: Positive | None = None
    """Weight W, down [N]; without it mass times gravity."""
    buoyancy: Positive | None = None
    """Buoyancy B, up [N]; without it the weight: a neutral vehicle."""
    gravity: Positive = 9.81
    """Acceleration of gravity, for the weight that is not given [m/s2]."""
    density: Positive | None = None
    """Density of the water [kg/m3]; needed for what depends on it: the prime system, cross-flow
    drag, lift and drag, fins with an area.
    """
    length: Positive | None = None
    """Length L of the vehicle [m], for the prime system; the cross-flow's unless it has its own."""


class HydroPart(Part):
    """[hydro]: Fossen's derivatives by name, forces as they act, and how they are meant.

    X_udot [kg, kg m, kg m2]: added mass, negative. X_u [N s/m]: linear. "X_|u|u" [N s2/m2]:
    quadratic. X_vr, Y_ur, Z_uw, M_uq: any product of two velocities. Velocities are relative to the
    water. Rows X, Y, Z, K, M, N; velocities u, v, w, p, q, r.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Number] = Field(init=False)

    prime: bool = False
    """The derivatives are in the prime system: multiplied by density/2 and the power of the length
    that belongs to them.
    """
    reference_speed: Positive | None = None
    """Speed U of linear derivatives in the prime system [m/s]."""
    coriolis: Literal["added-mass", "given"] = "added-mass"
    """Coriolis forces of the added mass: computed from it, or only the products that are listed."""
    coriolis_without: list[Entry] = Field(default_factory=list)
    """Entries [row, column] of the Coriolis matrix of the added mass that are left out, from 1, as
    some models leave out the Munk moment.
    """
    rigid_body_coriolis: bool = True
    """Compute the Coriolis forces of the rigid body; false: they are among the products listed."""
    current: Literal["attitude", "heading"] = "attitude"
    """How the current is turned into body axes: by the whole attitude, or, as in MSS, by the
    heading alone.
    """
    fading: dict[Text, Positive] = Field(default_factory=dict)
    """Linear damping that fades with the speed U through the water: { X_u = 3.0 } multiplies X_u by
    exp(-3 U) [s/m].
    """


class CrossFlowPart(Part):
    """[cross_flow]: drag of the hull across its axis, strip by strip."""

    length: Positive | None = None
    """Length of the hull, about the origin [m]; without it that of [body]."""
    height: Positive
    """Height of the hull, which sway and yaw move against [m]."""
    breadth: Positive
    """Breadth of the hull, which heave and pitch move against [m]."""
    drag: Annotated[list[NotNegative], Field(min_length=2, max_length=2)] | Literal["hoerner"]
    """Drag coefficients of a strip [in sway, in heave]; 0 leaves one out; "hoerner": both from
    Hoerner's curve by breadth and height.
    """
    strips: Annotated[int, Field(ge=1, le=100)] = 20
    """Number of strips of the same length."""
    rule: Literal["middle", "ends"] = "middle"
    """Speed of a strip: in its middle; "ends" as MSS sums: at the ends of all strips, each as a
    whole strip, one more than there are.
    """
    coupled: bool = False
    """The drag is along the speed across the hull, (v, w); otherwise sway and heave are apart."""
    softening: Positive | None = None
    """With coupled: speed that keeps the direction defined at rest [m/s]."""
    pitch: Literal["physical", "opposite"] = "physical"
    """Pitch moment of the coupled drag: that of the forces; "opposite" as npsauv.m writes it, with
    w + x q beside w - x q.
    """


class LiftDragPart(Part):
    """[lift_drag]: lift and drag of the body as a wing, by its angle of attack atan2(w, u)."""

    span: Positive
    """Span b of the wing [m]."""
    area: Positive
    """Area S of the wing [m2]."""
    drag: NotNegative
    """Drag coefficient at no angle of attack, on the area."""
    oswald: Positive = 0.7
    """Oswald efficiency e of the induced drag, lift^2 / (pi e b^2 / S)."""
    slope: Positive | None = None
    """Slope of the lift coefficient [1/rad]; without it that of a wing of this span and area."""
    stall: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Blending of the lift at large angles, 0: linear, 1: 2 sign(alpha) sin^2 cos."""


class OnboardDampingPart(Part):
    """[onboard_damping]: a loop on board that brakes each velocity, on data of some age."""

    rates: dict[Literal["u", "v", "w", "p", "q", "r"], NotNegative]
    """Rate a of each velocity, nu' = ... - a nu(t - delay) [1/s]."""
    delay: NotNegative
    """Age of its data [s]."""


class ThrusterPart(Part):
    """[[thrusters]]: a force along a line that is fixed to the vehicle."""

    name: Name
    """Its command is thruster.NAME."""
    direction: Vector
    """Unit vector of the force for a positive thrust; [0, 0, 0]: a moment alone."""
    position: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Where the force acts, from the origin of the body axes [m]."""
    moment: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Further moment per thrust, of the propeller's torque [N m/N]; for a moment alone its axis."""
    limit: Positive
    """Largest thrust in both directions [N]; of a moment alone [N m]."""
    lag: NotNegative = 0.0
    """Time constant of the thrust behind its command [s]; 0: at once, and no state."""


class FinPart(Part):
    """[[fins]]: a control surface: lift and drag by its angle and speed, or derivatives."""

    name: Name
    """Its command is fin.NAME."""
    area: Positive | None = None
    """Area of the fin [m2]."""
    lift: Positive | None = None
    """Slope of its lift coefficient [1/rad]: lift is density/2 area U^2 lift angle."""
    drag: NotNegative = 0.0
    """Its drag coefficient per squared angle [1/rad2]: density/2 area U^2 drag angle^2, aft."""
    direction: Vector | None = None
    """Unit vector of the lift at a positive angle, across x: [0, -1, 0] of a rudder that is turned
    about z, [0, 0, -1] of stern planes; U^2 is u^2 plus the squared speed along it.
    """
    position: Vector = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Where lift and drag act, from the origin of the body axes [m]."""
    derivatives: dict[Text, Number] = Field(default_factory=dict)
    """Forces by derivatives, in place of the area or beside it: products of up to two velocities
    with the angle d or its square: { Y_uud = 2.7e-2, X_uudd = -1e-2 }, prime if [hydro] is.
    """
    limit: Positive
    """Largest angle to both sides [rad]."""
    lag: NotNegative = 0.0
    """Time constant of the angle behind its command [s]; 0: at once, and no state."""


class SensorPart(Part):
    """[[sensors]]: what is measured, how often, how exactly, and how old it is."""

    name: Name
    """Its name in the design and in the scenario."""
    measures: Annotated[list[Text], Field(min_length=1)]
    """Outputs of the plant: ["eta.x", "nu.u"]."""
    interval: NotNegative
    """Time from one measurement to the next [s]; 0: at every communication point."""
    noise: NotNegative | list[NotNegative] = 0.0
    """Standard deviation of each value, in its unit; one for all, or one each."""
    age: NotNegative = 0.0
    """Greatest age of the value when it acts, from the instant it was measured [s]."""
    over: Literal["onboard", "link"] = "onboard"
    """Whether its values are there at once, or come over the link from outside."""


class TrimPart(Part):
    """[trim]: the steady motion that the design is about; every other velocity is zero."""

    u: Number = 0.0
    """Surge speed through the water [m/s]; 0: hover. Without it hover, or, where only fins steer,
    the greatest usual speed that takes half of no actuator.
    """


class ControlPart(Part):
    """[control]: what the design controls, and how much each part counts."""

    states: Annotated[list[Text], Field(min_length=1)] | None = None
    """States that are controlled, in this order; without it those that the actuators move and the
    sensors show, roll and pitch only where no restoring moment holds them.
    """
    weights: dict[Text, Positive] = Field(default_factory=dict)
    """Weight in z of a state or of an actuator by name: { "eta.x" = 0.1 }."""


class VehicleFile(Part):
    """A vehicle file."""

    described_by: ClassVar[str | None] = "cosim vehicle show --keys"

    name: Annotated[str, AfterValidator(_title)]
    """Name of the vehicle."""
    description: str = ""
    """What it is, in a sentence."""
    source: str = ""
    """Where the numbers are from: publication and table, or software and file."""
    degrees_of_freedom: Literal[4, 6]
    """4: surge, sway, heave and yaw of a level vehicle; 6: roll and pitch as well."""
    attitude: Literal["euler", "quaternion"] = "euler"
    """States of the attitude in 6 degrees of freedom: Euler angles, which have no rates at pitch
    +-90 degrees, or a quaternion.
    """
    body: BodyPart
    """Mass, inertia, weight and buoyancy."""
    hydro: HydroPart
    """Added mass and damping, by Fossen's derivatives."""
    cross_flow: CrossFlowPart | None = None
    """Cross-flow drag of the hull by strips."""
    lift_drag: LiftDragPart | None = None
    """Lift and drag of the body."""
    onboard_damping: OnboardDampingPart | None = None
    """A damping loop on board."""
    thrusters: list[ThrusterPart] = Field(default_factory=list)
    """Thrusters."""
    fins: list[FinPart] = Field(default_factory=list)
    """Control surfaces."""
    sensors: list[SensorPart] = Field(default_factory=list)
    """Sensors; without any those that such vehicles carry: Doppler log, attitude, gyro, depth, and
    fixes over the link.
    """
    trim: TrimPart = Field(default_factory=TrimPart)
    """The steady motion that the design is about."""
    envelope: dict[Text, Any] = Field(default_factory=dict)
    """Bound of a state about the trim, by its name: "nu.u" = 0.3, "eta.psi" = 0.2. Without one:
    0.15 m/s for speeds, 0.1 rad/s for rates, 0.1 rad for roll and pitch, 0.175 rad for the heading.
    """
    control: ControlPart = Field(default_factory=ControlPart)
    """What the design controls."""
