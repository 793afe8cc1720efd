"""The vehicle: four degrees of freedom under water, Eqs. (1)-(4) of the paper.

State eta = (x, y, z, psi) [m, m, m, rad] in the earth frame, nu = (u, v, w, r)
[m/s, m/s, m/s, rad/s] in the body frame:

    eta' = J(psi) nu                                             kinematics, Eq. (2)
    M nu' = h(nu) + tau                                          dynamics, Eq. (3)

with the hydrodynamic derivatives of Table 1, non-dimensional in powers of the length L.
Eq. (6) gives no A1 and no C for the vehicle. This project adds an onboard rate-damping loop on
navigation data `delay.d` seconds old, and wave and current accelerations w:

    nu' = M^-1 (h(nu) + tau) - diag(a) nu(t-d) + w

Written once for scalars, with `sin` and `cos` from a given namespace: `vehicle_derivatives` with
floats simulates, with symbols gives the C code, with arrays the vectorised check. Standard
library only: this file is also part of the FMU.

Corrections of the printed paper (each is needed to reproduce its f and B):
X_udot = -7.6e-3 (printed +), N_ur = -1.6e-2 (printed -1.6e-3), "X_vw" is X_vv, "Z_vw" is
Z_vv, "Y_r r^2" in Eq. (3) is Y_rdot r', the sway row omits Y_wr w r, and the off-diagonal
of the thrust map is +2.40e-6.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from itertools import combinations_with_replacement
from types import MappingProxyType
from typing import Any

STATE = ("eta.x", "eta.y", "eta.z", "eta.psi", "nu.u", "nu.v", "nu.w", "nu.r")
"""State names, in the order of the vectors here."""

TABLE_1: Mapping[str, float] = MappingProxyType(
    {
        "mass": 5454.0,  # kg
        "inertia.z": 13587.0,  # kg m^2
        "density": 1000.0,  # kg/m^3
        "length": 5.3,  # m
        "hydro.X_udot": -7.6e-3,
        "hydro.X_vv": 5.3e-2,
        "hydro.X_ww": 1.7e-1,
        "hydro.X_rr": 4.0e-3,
        "hydro.X_vr": 2.0e-2,
        "hydro.Y_vdot": -5.5e-2,
        "hydro.Y_rdot": 1.2e-3,
        "hydro.Y_uv": -1.0e-1,
        "hydro.Y_ur": 3.0e-2,
        "hydro.Y_vw": 6.8e-2,
        "hydro.Y_wr": -1.9e-2,
        "hydro.Z_wdot": -2.4e-1,
        "hydro.Z_vv": -6.8e-2,
        "hydro.Z_rr": -7.4e-3,
        "hydro.Z_uw": -3.0e-1,
        "hydro.Z_vr": 4.5e-2,
        "hydro.N_vdot": 1.2e-3,
        "hydro.N_rdot": -3.4e-3,
        "hydro.N_uv": -7.4e-3,
        "hydro.N_vw": -2.7e-2,
        "hydro.N_ur": -1.6e-2,
        "hydro.N_wr": 7.4e-3,
    }
)
"""Table 1 as corrected, by FMI parameter name (SI units; derivatives dimensionless)."""


def inertia(p: Mapping[str, Any]) -> list[list[Any]]:
    """Return the mass matrix M (4x4) of Eq. (3) with added mass [kg, kg m, kg m^2].

    `p` maps the names of `TABLE_1` to scalars.
    """
    half_rho, length = p["density"] / 2, p["length"]
    l3 = half_rho * length**3
    l4 = half_rho * length**4
    l5 = half_rho * length**5
    return [
        [p["mass"] - l3 * p["hydro.X_udot"], 0.0, 0.0, 0.0],
        [0.0, p["mass"] - l3 * p["hydro.Y_vdot"], 0.0, -l4 * p["hydro.Y_rdot"]],
        [0.0, 0.0, p["mass"] - l3 * p["hydro.Z_wdot"], 0.0],
        [0.0, -l4 * p["hydro.N_vdot"], 0.0, p["inertia.z"] - l5 * p["hydro.N_rdot"]],
    ]


def thrust_map(p: Mapping[str, Any]) -> list[list[Any]]:
    """Return M^-1 (4x4), body accelerations per force and moment, the matrix of Eq. (4).

    Closed form: only sway and yaw are coupled.
    """
    m = inertia(p)
    det = m[1][1] * m[3][3] - m[1][3] * m[3][1]
    return [
        [1 / m[0][0], 0.0, 0.0, 0.0],
        [0.0, m[3][3] / det, 0.0, -m[1][3] / det],
        [0.0, 0.0, 1 / m[2][2], 0.0],
        [0.0, -m[3][1] / det, 0.0, m[1][1] / det],
    ]


def vehicle_conditions(p: Mapping[str, Any]) -> list[tuple[Any, str]]:
    """Return the quantities that must be positive for valid parameters `p`, with messages."""
    m = inertia(p)
    diagonal = "mass plus added mass must be positive in surge, sway and heave"
    return [
        (m[0][0], diagonal),
        (m[1][1], diagonal),
        (m[2][2], diagonal),
        (
            m[1][1] * m[3][3] - m[1][3] * m[3][1],
            "the sway-yaw block of the mass matrix must be positive definite",
        ),
    ]


def hydrodynamic_force(nu: tuple[Any, Any, Any, Any], p: Mapping[str, Any]) -> list[Any]:
    """Return h(nu) of Eq. (3): rigid-body and hydrodynamic force and moment [N, N, N, N m]."""
    u, v, w, r = nu
    half_rho, length, mass = p["density"] / 2, p["length"], p["mass"]
    l2 = half_rho * length**2
    l3 = half_rho * length**3
    l4 = half_rho * length**4
    return [
        mass * v * r
        + l4 * p["hydro.X_rr"] * r * r
        + l3 * p["hydro.X_vr"] * v * r
        + l2 * (p["hydro.X_vv"] * v * v + p["hydro.X_ww"] * w * w),
        -mass * u * r
        + l3 * (p["hydro.Y_ur"] * u * r + p["hydro.Y_wr"] * w * r)
        + l2 * (p["hydro.Y_uv"] * u * v + p["hydro.Y_vw"] * v * w),
        l4 * p["hydro.Z_rr"] * r * r
        + l3 * p["hydro.Z_vr"] * v * r
        + l2 * (p["hydro.Z_uw"] * u * w + p["hydro.Z_vv"] * v * v),
        l4 * (p["hydro.N_ur"] * u * r + p["hydro.N_wr"] * w * r)
        + l3 * (p["hydro.N_uv"] * u * v + p["hydro.N_vw"] * v * w),
    ]


def apply_thrust_map(b: list[list[Any]], force: list[Any]) -> list[Any]:
    """Return the accelerations b @ force, using the structure of `thrust_map`."""
    return [
        b[0][0] * force[0],
        b[1][1] * force[1] + b[1][3] * force[3],
        b[2][2] * force[2],
        b[3][1] * force[1] + b[3][3] * force[3],
    ]


def kinematics(psi: Any, nu: tuple[Any, Any, Any, Any], ns: Any) -> list[Any]:
    """Return eta' = J(psi) nu, Eq. (2); `ns` provides `sin` and `cos`."""
    u, v, w, r = nu
    c, s = ns.cos(psi), ns.sin(psi)
    return [u * c - v * s, u * s + v * c, w, r]


def vehicle_derivatives(
    state: Any,
    delayed_nu: Any,
    tau: Any,
    disturbance: Any,
    p: Mapping[str, Any],
    b: list[list[Any]],
    ns: Any,
) -> list[Any]:
    """Return x' (8) of the vehicle.

    Parameters
    ----------
    state : (x, y, z, psi, u, v, w, r).
    delayed_nu : nu(t-d), (u, v, w, r).
    tau : force x, y, z [N] and moment z [N m].
    disturbance : accelerations of u, v, w [m/s^2] and r [rad/s^2].
    p : names of `TABLE_1` and `damping.u`, `.v`, `.w`, `.r` [1/s] to scalars.
    b : `thrust_map(p)`, passed in since it is constant over a run.
    ns : namespace with `sin` and `cos` (math, numpy, sympy).
    """
    nu = (state[4], state[5], state[6], state[7])
    h = hydrodynamic_force(nu, p)
    acceleration = apply_thrust_map(b, [h[i] + tau[i] for i in range(4)])
    damping = (p["damping.u"], p["damping.v"], p["damping.w"], p["damping.r"])
    return kinematics(state[3], nu, ns) + [
        acceleration[i] - damping[i] * delayed_nu[i] + disturbance[i] for i in range(4)
    ]


def velocity_coefficients(p: Mapping[str, Any]) -> list[dict[str, Fraction]]:
    """Return the quadratic part of f(x), Eq. (4): per row of nu', coefficient by product of nu.

    Row 0 is {"vv": 0.124, "ww": 0.397, "rr": 0.262, "vr": 1.153} in the paper. Computed from
    `hydrodynamic_force`, a quadratic form in nu, by polarisation: the coefficient of ab is
    q(a + b) - q(a) - q(b). The arithmetic is exact in the given numbers (doubles, or Fractions
    of the decimals), so that absent coefficients are exactly zero.
    """
    exact = {name: Fraction(value) for name, value in p.items()}
    b = thrust_map(exact)

    def q(*moving: int) -> list[Any]:
        u, v, w, r = (1 if i in moving else 0 for i in range(4))
        return apply_thrust_map(b, hydrodynamic_force((u, v, w, r), exact))

    rows: list[dict[str, Fraction]] = [{}, {}, {}, {}]
    squares = [q(i) for i in range(4)]
    for i, j in combinations_with_replacement(range(4), 2):
        pair = q(i, j)
        for row, coefficients in enumerate(rows):
            square = squares[i][row]
            value = square if i == j else pair[row] - square - squares[j][row]
            if value != 0:
                coefficients["uvwr"[i] + "uvwr"[j]] = value
    return rows
