"""A vehicle under water in 4 or 6 degrees of freedom, with the terms that its file names.

    eta' = J(eta) nu
    M nu_r' + C(nu_r) nu_r = tau_hydro(nu_r) + tau_restoring + tau_actuators
    nu' = nu_r' + nu_c' - diag(a) nu(t-d) + w,    nu_c = R' v_c,    nu_c' = -omega x nu_c

nu_r = nu - nu_c is the velocity relative to the water, v_c the current, constant in the earth's
frame; a constant current changes nothing but nu_c (rigid-body terms in nu_r are exact then). The
term with nu(t-d) is an onboard rate-damping loop on data d seconds old, w are accelerations.

Written once over scalars: floats simulate, recorded scalars give the C, arrays and balls check.
Which terms there are is decided when a vehicle is made, never by a value. `ns` provides sin, cos,
sqrt, exp, atan2, asin, min and max of two. Standard library only: this file is also part of the
FMU.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cosim.models.vehicle_actuators import (
    fin_derivatives,
    fin_lift_and_drag,
    thruster_force,
)
from cosim.models.vehicle_attitude import (
    cross,
    euler_angles,
    euler_rates,
    euler_rotation,
    heading_in_body,
    heading_in_earth,
    in_body,
    in_earth,
    quaternion_rates,
    quaternion_rotation,
)
from cosim.models.vehicle_forces import (
    Derivative,
    Force,
    add_force,
    added_mass,
    coupled_cross_flow,
    derivative_named,
    factor_product,
    lift_and_drag,
    lift_slope,
    restoring_force,
    separate_cross_flow,
    strip_places,
)
from cosim.models.vehicle_inertia import (
    VELOCITIES,
    axes_of,
    coriolis_force,
    matrix_sum,
    multiplied,
    pivots_and_inverse,
    rigid_body_mass,
    symmetric_part,
)

_ANGLES = {4: ("psi",), 6: ("phi", "theta", "psi")}


class FloatFunctions:
    """The namespace of functions for equations over floats."""

    sin, cos, sqrt, exp = math.sin, math.cos, math.sqrt, math.exp
    atan2, asin = math.atan2, math.asin
    min, max = min, max


class VehicleEquations:
    """The equations of one vehicle.

    Parameters
    ----------
    terms : which terms there are, JSON values: `degrees_of_freedom`, `attitude`, `r_g`, `r_b`,
        `inertia`, `weight`, `buoyancy`, `prime`, `derivatives`, `fading`, `coriolis`,
        `coriolis_without`, `rigid_body_coriolis`, `current`, `cross_flow`, `lift_drag`,
        `damping`, `thrusters`, `fins`, as `cosim.vehicle` makes them of a vehicle file.

    Attributes
    ----------
    states : FMI names of x: eta or its quaternion, nu, and the actuators that have a lag.
    inputs : FMI names of u: commands, current, disturbance.
    delays : names of the delays of `late`: "delay.d" with onboard damping.
    """

    def __init__(self, terms: Mapping[str, Any]) -> None:
        self.terms = terms
        dof: int = terms["degrees_of_freedom"]
        self._axes = axes_of(dof)
        self._quaternion = terms["attitude"] == "quaternion"
        self._level = dof == 4
        named = [derivative_named(name) for name in terms["derivatives"]]
        self._derivatives: list[Derivative] = [d for d in named if d is not None]
        self._without = {(i - 1, j - 1) for i, j in terms["coriolis_without"]}
        quaternion = tuple(f"quaternion.q{i}" for i in range(4))
        turned = quaternion if self._quaternion else tuple(f"eta.{a}" for a in _ANGLES[dof])
        letters = [VELOCITIES[i] for i in self._axes]
        self._attitude = slice(3, 3 + len(turned))
        self._motion = 3 + len(turned)
        self._actuators = [("thruster", t) for t in terms["thrusters"]]
        self._actuators += [("fin", f) for f in terms["fins"]]
        lagged = [f"actual.{a['name']}" for _, a in self._actuators if a["lag"]]
        self.states = (
            *("eta.x", "eta.y", "eta.z", *turned),
            *(f"nu.{letter}" for letter in letters),
            *lagged,
        )
        self.inputs = (
            *(f"{kind}.{a['name']}" for kind, a in self._actuators),
            *("current.x", "current.y", "current.z"),
            *(f"disturbance.{letter}" for letter in letters),
        )
        self.delays = ("delay.d",) if terms["damping"] else ()

    def conditions(self, p: Mapping[str, Any]) -> list[tuple[Any, str]]:
        """Return the quantities that must be positive for valid parameters, with messages."""
        pivots, _ = pivots_and_inverse(symmetric_part(self.mass_matrix(p)), self._axes)
        text = "the mass matrix with added mass must be positive definite: it fails at nu."
        conditions = [
            (pivot, f"{text}{VELOCITIES[axis]}")
            for pivot, axis in zip(pivots, self._axes, strict=True)
        ]
        if self._quaternion:
            q = [p[f"initial.quaternion.q{i}"] for i in range(4)]
            off = abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0)
            conditions.append((1e-6 - off, "the initial quaternion must have the length 1"))
        return conditions

    def dimensional(self, p: Mapping[str, Any]) -> dict[str, Any]:
        """Return the dimensional derivatives by name."""
        prime = self.terms["prime"]
        values = {}
        for d in self._derivatives:
            value = p[f"hydro.{d.parameter}"]
            values[d.name] = d.scale(p, prime=prime) * value if prime else value
        return values

    def mass_matrix(self, p: Mapping[str, Any]) -> dict[tuple[int, int], Any]:
        """Return M = M_RB + M_A, sparse, by axes 0 to 5."""
        rigid = rigid_body_mass(p, self.terms["r_g"], self.terms["inertia"], self._axes)
        added = added_mass(self._derivatives, self.dimensional(p), self._axes)
        return matrix_sum(rigid, added)

    def constants(self, p: Mapping[str, Any], ns: Any = FloatFunctions) -> dict[str, Any]:
        """Return what depends on the parameters alone."""
        terms, axes = self.terms, self._axes
        coefficients = self.dimensional(p)
        rigid = rigid_body_mass(p, terms["r_g"], terms["inertia"], axes)
        added = added_mass(self._derivatives, coefficients, axes)
        _, inverse = pivots_and_inverse(matrix_sum(rigid, added), axes)
        return {
            "p": p,
            "rigid": rigid if terms["rigid_body_coriolis"] else None,
            "added": symmetric_part(added) if terms["coriolis"] == "added-mass" else None,
            "inverse": inverse,
            "coefficients": coefficients,
            "cross_flow": self._cross_flow(p),
            "wing": self._wing(p, ns),
            "restoring": self._restoring(p),
            "thrusters": [
                {letter: p[f"effect.{t['name']}.{letter}"] for letter in t["effects"]}
                for t in terms["thrusters"]
            ],
            "fins": [self._fin(p, f) for f in terms["fins"]],
        }

    def _cross_flow(self, p: Mapping[str, Any]) -> Any:
        part = self.terms["cross_flow"]
        if part is None:
            return None
        length = p["cross_flow.length"]
        strip = p["density"] / 2 * (length / part["strips"])
        sway = heave = None
        if "sway" in part["planes"]:
            sway = strip * p["cross_flow.height"] * p["cross_flow.drag_sway"]
        if "heave" in part["planes"]:
            heave = strip * p["cross_flow.breadth"] * p["cross_flow.drag_heave"]
        return strip_places(length, part["strips"], part["rule"]), sway, heave

    def _wing(self, p: Mapping[str, Any], ns: Any) -> Any:
        part = self.terms["lift_drag"]
        if part is None:
            return None
        aspect = p["lift_drag.span"] * p["lift_drag.span"] / p["lift_drag.area"]
        return {
            "pressure": p["density"] / 2 * p["lift_drag.area"],
            "slope": p["lift_drag.slope"] if part["slope"] else lift_slope(aspect, ns),
            "drag": p["lift_drag.drag"],
            "induced": math.pi * p["lift_drag.oswald"] * aspect,
            "stall": p["lift_drag.stall"] if part["stall"] else None,
        }

    def _restoring(self, p: Mapping[str, Any]) -> tuple[Any, dict[int, Any]]:
        terms = self.terms
        if terms["weight"] is None:
            return None, {}
        weight = p["weight"] if terms["weight"] == "given" else p["mass"] * p["gravity"]
        neutral = terms["buoyancy"] == "weight"
        buoyancy = weight if neutral else p["buoyancy"]
        moment: dict[int, Any] = {}
        for i, axis in enumerate("xyz"):
            if axis in terms["r_g"]:
                moment[i] = p[f"r_g.{axis}"] * weight
            if axis in terms["r_b"]:
                less = p[f"r_b.{axis}"] * buoyancy
                moment[i] = moment[i] - less if i in moment else -less
        return None if neutral else weight - buoyancy, moment

    def _fin(self, p: Mapping[str, Any], fin: Mapping[str, Any]) -> dict[str, Any]:
        name = fin["name"]
        values: dict[str, Any] = {"coefficients": {}, "pressure": None}
        for key in fin["derivatives"]:
            d = derivative_named(key)
            if d is not None:
                value = p[f"derivative.{name}.{d.parameter}"]
                prime = self.terms["prime"]
                values["coefficients"][key] = d.scale(p, prime=prime) * value if prime else value
        if fin["area"]:
            values["pressure"] = p["density"] / 2 * p[f"area.{name}"]
            values["lift"] = p[f"lift.{name}"]
            values["drag"] = p[f"drag.{name}"] if fin["drag"] else None
            for key in ("direction", "position"):
                values[key] = {"xyz".index(a): p[f"{key}.{name}.{a}"] for a in fin[key]}
        return values

    def rates(
        self, x: Sequence[Any], delayed: Sequence[Any], u: Sequence[Any], c: Any, ns: Any
    ) -> list[Any]:
        """Return x'.

        Parameters
        ----------
        x : in the order of `states`.
        delayed : x(t-d), the whole state; empty without onboard damping.
        u : in the order of `inputs`.
        c : `constants`.
        ns : namespace of functions.
        """
        p, axes = c["p"], self._axes
        attitude, first = x[self._attitude], self._motion
        nu = dict(zip(axes, x[first : first + len(axes)], strict=True))
        omega = [nu.get(3), nu.get(4), nu[5]]
        count = len(self._actuators)
        current, disturbance = u[count : count + 3], u[count + 3 :]
        R: list[list[Any]] | None = None
        if not self._level:
            angles = tuple(attitude)
            R = (
                quaternion_rotation(angles)
                if self._quaternion
                else euler_rotation(angles[0], angles[1], angles[2], ns)
            )
        nu_r, change = self._relative(nu, omega, attitude, R, current, ns)
        actual, lag_rates = self._actuated(x[first + len(axes) :], u, p, ns)
        total = self._forces(nu_r, actual, R, c, ns)
        acceleration = multiplied(c["inverse"], total)
        damped = dict(zip(axes, delayed[first : first + len(axes)], strict=True)) if delayed else {}
        dnu = []
        for i, axis in enumerate(axes):
            rate = acceleration.get(axis, 0.0)
            if axis in change:
                rate = rate + change[axis]
            if VELOCITIES[axis] in self.terms["damping"]:
                rate = rate - p[f"damping.{VELOCITIES[axis]}"] * damped[axis]
            dnu.append(rate + disturbance[i])
        v = [nu[0], nu[1], nu[2]]
        if R is None:
            deta = [*heading_in_earth(attitude[0], v, ns), nu[5]]
        elif self._quaternion:
            deta = [*in_earth(R, v), *quaternion_rates(attitude, omega)]
        else:
            deta = [*in_earth(R, v), *euler_rates(attitude[0], attitude[1], omega, ns)]
        return [*deta, *dnu, *lag_rates]

    def euler(self, x: Sequence[Any], ns: Any) -> dict[str, Any]:
        """Return the Euler angles of a vehicle with a quaternion by name; else nothing."""
        if not self._quaternion:
            return {}
        angles = euler_angles(x[self._attitude], ns)
        return dict(zip(("eta.phi", "eta.theta", "eta.psi"), angles, strict=True))

    def _relative(
        self, nu: Force, omega: Sequence[Any], attitude: Any, R: Any, current: Any, ns: Any
    ) -> tuple[Force, Force]:
        """Return nu_r, and nu_c' in body axes."""
        if R is None or self.terms["current"] == "heading":
            flow = heading_in_body(attitude[-1], current, ns)
            change = {0: omega[2] * flow[1], 1: -(omega[2] * flow[0])}
        else:
            flow = in_body(R, current)
            change = dict(enumerate(cross(flow, omega)))
        return {**nu, **{i: nu[i] - flow[i] for i in range(3)}}, change

    def _actuated(
        self, states: Sequence[Any], u: Sequence[Any], p: Mapping[str, Any], ns: Any
    ) -> tuple[list[Any], list[Any]]:
        """Return what each actuator does now, and the rates of those with a lag."""
        actual: list[Any] = []
        rates: list[Any] = []
        for (_, a), command in zip(self._actuators, u[: len(self._actuators)], strict=True):
            limit = p[f"limit.{a['name']}"]
            wanted = ns.max(-limit, ns.min(limit, command))
            if a["lag"]:
                state = states[len(rates)]
                actual.append(state)
                rates.append((wanted - state) / p[f"lag.{a['name']}"])
            else:
                actual.append(wanted)
        return actual, rates

    def _forces(self, nu: Force, actual: Sequence[Any], R: Any, c: Any, ns: Any) -> Force:
        """Return all forces on the vehicle by axis, Coriolis forces included."""
        total: Force = {}
        axes = self._axes
        for mass, without in ((c["rigid"], ()), (c["added"], self._without)):
            if mass is not None:
                for row, force in coriolis_force(mass, nu, without).items():
                    add_force(total, row, -force)
        self._derivative_forces(nu, c, total, ns)
        self._cross_flow_forces(nu, c, total, ns)
        if c["wing"] is not None:
            lift_and_drag(nu, c["wing"], total, ns)
        net, moment = c["restoring"]
        if R is not None:
            restoring_force(net, moment, R[2], total)
        elif net is not None:
            add_force(total, 2, net)
        thrusters = c["thrusters"]
        for thrust, effects in zip(actual, thrusters, strict=False):
            thruster_force(thrust, effects, axes, total)
        for angle, fin in zip(actual[len(thrusters) :], c["fins"], strict=True):
            if fin["pressure"] is not None:
                fin_lift_and_drag(angle, fin, nu, axes, total)
            fin_derivatives(angle, fin["coefficients"], nu, total)
        return {row: total[row] for row in sorted(total) if row in axes}

    def _cross_flow_forces(self, nu: Force, c: Any, total: Force, ns: Any) -> None:
        part = self.terms["cross_flow"]
        if part is None:
            return
        x, sway, heave = c["cross_flow"]
        if not part["coupled"]:
            separate_cross_flow(nu, x, sway, heave, total)
            return
        softening = c["p"]["cross_flow.softening"]
        opposite = part["pitch"] == "opposite"
        coupled_cross_flow(nu, x, sway, heave, softening, total, ns, opposite=opposite)

    def _derivative_forces(self, nu: Force, c: Any, total: Force, ns: Any) -> None:
        speed = None
        for d in self._derivatives:
            if d.dot:
                continue
            product = factor_product(d, nu)
            if product is None or d.row not in self._axes:
                continue
            term = c["coefficients"][d.name] * product
            if d.name in self.terms["fading"]:
                if speed is None:
                    speed = ns.sqrt(nu[0] * nu[0] + nu[1] * nu[1] + nu[2] * nu[2])
                term = term * ns.exp(-(c["p"][f"fading.{d.parameter}"] * speed))
            add_force(total, d.row, term)
