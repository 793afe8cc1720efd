"""Hydrodynamic and hydrostatic forces on a vehicle: derivatives, cross-flow drag, lift and drag.

Velocities are relative to the water. Forces are as they act, by row (0 to 5: X, Y, Z, K, M, N).

    derivatives    X = X_u u + X_|u|u |u| u + X_vr v r + ...       (each with its row and factors)
    fading         X_u u exp(-c U)                                  damping at low speed only
    cross-flow     strips dx of the hull: Y = -rho/2 h Cd sum |v + x r| (v + x r) dx, ...
    lift and drag  of the body as a wing at the angle of attack alpha = atan2(w, u)
    restoring      (W - B) k and (r_g W - r_b B) x k, k: down, in body axes

In the prime system a derivative is multiplied by rho/2 and the power of L of its row and factors.
Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cosim.models.vehicle_inertia import FORCES, VELOCITIES, Sparse

Force = dict[int, Any]

_ANGULAR = "pqr"


class Derivative(NamedTuple):
    """A hydrodynamic derivative, such as X_udot, X_u, X_|u|u, Y_ur; of a fin also Y_uud.

    Attributes
    ----------
    row : of the force or moment, 0 to 5.
    factors : letters of the velocities, an absolute value first.
    absolute : whether the first factor is an absolute value.
    dot : whether it is of an acceleration (added mass).
    angles : power of a fin's angle, 0 to 2.
    """

    row: int
    factors: str
    absolute: bool = False
    dot: bool = False
    angles: int = 0

    @property
    def name(self) -> str:
        """The name as Fossen writes it, factors in the order of the axes."""
        tail = f"|{self.factors[0]}|{self.factors[1:]}" if self.absolute else self.factors
        return f"{FORCES[self.row]}_{tail}{'dot' * self.dot}{'d' * self.angles}"

    @property
    def parameter(self) -> str:
        """The name as a part of an FMI name: |u|u is abs_u_u."""
        tail = f"abs_{self.factors[0]}_{self.factors[1:]}" if self.absolute else self.factors
        return f"{FORCES[self.row]}_{tail}{'dot' * self.dot}{'d' * self.angles}"

    @property
    def power(self) -> int:
        """The power of L that goes with rho/2 in the prime system."""
        turning = sum(letter in _ANGULAR for letter in self.factors) + (self.row > 2)
        return turning + (3 if self.dot else 2)

    def scale(self, p: Mapping[str, Any], *, prime: bool) -> Any:
        """Return what the given number is multiplied by; 1.0 for a dimensional one."""
        if not prime:
            return 1.0
        scale = p["density"] / 2 * p["length"] ** self.power
        speeds = len(self.factors) - self.dot
        return scale * p["hydro.reference_speed"] if speeds == 1 and not self.dot else scale


def derivative_named(name: str) -> Derivative | None:
    """Return the derivative of a name, factors in any order; None if there is none such."""
    head, _, tail = name.partition("_")
    if len(head) != 1 or head not in FORCES or not tail:
        return None
    row = FORCES.index(head)
    if tail.endswith("dot") and len(tail) == 4 and tail[0] in VELOCITIES:
        return Derivative(row, tail[0], dot=True)
    angles = len(tail) - len(tail.rstrip("d"))
    body = tail.rstrip("d")
    plain = "".join(c for c in body if c != "|")
    if (
        not set(plain) <= set(VELOCITIES)
        or len(plain) > 2
        or angles > 2
        or not plain + "d" * angles
    ):
        return None
    ordered = "".join(sorted(plain, key=VELOCITIES.index))
    if "|" not in body:
        return Derivative(row, ordered, angles=angles)
    if len(plain) != 2 or body not in (f"|{plain[0]}|{plain[1]}", f"{plain[0]}|{plain[1]}|"):
        return None
    first = plain if body[0] == "|" else plain[::-1]
    return Derivative(row, first, absolute=True, angles=angles)


def add_force(total: Force, row: int, value: Any) -> None:
    """Add a force to the row of a total."""
    total[row] = total[row] + value if row in total else value


def factor_product(of: Derivative, nu: Mapping[int, Any]) -> Any:
    """Return the product of the velocities of a derivative; None if one is always zero."""
    places = [VELOCITIES.index(letter) for letter in of.factors]
    if any(place not in nu for place in places):
        return None
    values = [nu[place] for place in places]
    if of.absolute:
        values[0] = abs(values[0])
    product = values[0] if values else 1.0
    for value in values[1:]:
        product = product * value
    return product


def added_mass(
    derivatives: Sequence[Derivative], coefficients: Mapping[str, Any], axes: Sequence[int]
) -> Sparse:
    """Return M_A; `coefficients`: dimensional derivatives by name."""
    entries = [(d, (d.row, VELOCITIES.index(d.factors))) for d in derivatives if d.dot]
    return {at: -coefficients[d.name] for d, at in entries if at[0] in axes and at[1] in axes}


def strip_places(length: Any, strips: int, rule: str) -> list[Any]:
    """Return x of the strips: their middles, or with "ends" the strips + 1 ends between them."""
    half, dx = length / 2, length / strips
    if rule == "ends":
        return [i * dx - half for i in range(strips + 1)]
    return [(i + 0.5) * dx - half for i in range(strips)]


def separate_cross_flow(
    nu: Mapping[int, Any], x: Sequence[Any], sway: Any, heave: Any, total: Force
) -> None:
    """Add the cross-flow drag of sway and of heave, each by itself.

    sway, heave : rho/2 times size times Cd times dx of a strip; None for none.
    """
    v, w, r, q = nu[1], nu[2], nu[5], nu.get(4)
    if sway is not None:
        across = [v + place * r for place in x]
        drags = [abs(speed) * speed for speed in across]
        add_force(total, 1, -sway * _added(drags))
        turned = [place * drag for place, drag in zip(x, drags, strict=True)]
        add_force(total, 5, -sway * _added(turned))
    if heave is not None:
        down = [w if q is None else w - place * q for place in x]
        drags = [abs(speed) * speed for speed in down]
        add_force(total, 2, -heave * _added(drags))
        turned = [place * drag for place, drag in zip(x, drags, strict=True)]
        add_force(total, 4, heave * _added(turned))


def coupled_cross_flow(
    nu: Mapping[int, Any],
    x: Sequence[Any],
    sway: Any,
    heave: Any,
    softening: Any,
    total: Force,
    ns: Any,
    *,
    opposite: bool = False,
) -> None:
    """Add the cross-flow drag along the cross-flow velocity of each strip, `coupled_drag`.

    opposite : the pitch moment as in npsauv.m, with w + x q beside w - x q.
    """
    sums: list[list[Any]] = [[], [], [], []]
    q = nu.get(4)
    # an enclosure cannot follow the root through zero, and brings one of the whole
    enclosed = None if opposite else getattr(ns, "coupled_drag", None)
    for place in x:
        v = nu[1] + place * nu[5]
        w = nu[2] if q is None else nu[2] - place * q
        if enclosed is not None:
            along, down = enclosed(v, w, sway, heave, softening)
            turning = -down
        else:
            along, down, drag = coupled_drag(v, w, sway, heave, softening, ns)
            turning = drag * (nu[2] + place * q) if opposite and q is not None else -down
        for terms, value in zip(sums, (along, down, place * turning, place * along), strict=True):
            terms.append(value)
    for row, terms in zip((1, 2, 4, 5), sums, strict=True):
        add_force(total, row, -_added(terms))


def coupled_drag(
    v: Any, w: Any, sway: Any, heave: Any, softening: Any, ns: Any
) -> tuple[Any, Any, Any]:
    """Return D v and D w, the drag of a strip across the hull, and D.

    D = (sway v^2 + heave w^2) / (sqrt(v^2 + w^2) + softening).
    """
    drag = (sway * (v * v) + heave * (w * w)) / (ns.sqrt(v * v + w * w) + softening)
    return drag * v, drag * w, drag


def lift_and_drag(nu: Mapping[int, Any], wing: Mapping[str, Any], total: Force, ns: Any) -> None:
    """Add lift and drag of the body as a wing (Beard and McLain 2012, ch. 4).

    wing : `pressure` (rho/2 times area), `slope` of the lift, `drag` at alpha = 0, `induced`
        (pi e AR), `stall` (blending of the lift at large alpha; None for none).
    """
    u, v, w = nu[0], nu[1], nu[2]
    alpha = ns.atan2(w, u)
    c, s = ns.cos(alpha), ns.sin(alpha)
    lift = wing["slope"] * alpha
    drag = wing["drag"] + lift * lift / wing["induced"]
    if wing["stall"] is not None:
        # sin |sin| is sign(alpha) sin^2
        lift = (1.0 - wing["stall"]) * lift + wing["stall"] * (2.0 * (abs(s) * s * c))
    pressure = wing["pressure"] * (u * u + v * v + w * w)
    lift, drag = pressure * lift, pressure * drag
    add_force(total, 0, s * lift - c * drag)
    add_force(total, 2, -(s * drag + c * lift))


def lift_slope(aspect: Any, ns: Any) -> Any:
    """Return the slope of the lift [1/rad] of a wing of an aspect ratio span^2 / area."""
    return math.pi * aspect / (1.0 + ns.sqrt(1.0 + aspect * aspect / 4.0))


def restoring_force(net: Any, moment: Mapping[int, Any], down: Sequence[Any], total: Force) -> None:
    """Add weight and buoyancy of a vehicle in 6 degrees of freedom.

    net : W - B [N]; None if the vehicle is neutral.
    moment : components of r_g W - r_b B [N m], those that may not be zero.
    down : unit vector down in body axes (3,).
    """
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if net is not None:
            add_force(total, i, net * down[i])
        if j in moment:
            add_force(total, 3 + i, moment[j] * down[k])
        if k in moment:
            add_force(total, 3 + i, -(moment[k] * down[j]))


def _added(terms: Sequence[Any]) -> Any:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total
