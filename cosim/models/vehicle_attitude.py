"""Attitude of a vehicle: rotation matrix and rates, by heading, Euler angles or a quaternion.

    eta' = R(attitude) v,   phi' = T(phi, theta) omega           (Fossen 2021, ch. 2)

R turns body axes into the earth's (north, east, down), zyx convention. Euler angles have no rates
at theta = +-90 degrees. The quaternion (q0, q1, q2, q3) has none such; R is that of q/|q|, and the
rates draw |q| back to 1. Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

QUATERNION_RATE = 1.0
"""Rate at which |q|^2 returns to 1 [1/s]; it acts on what the integrator's error leaves."""

Rotation = list[list[Any]]


def heading_in_body(psi: Any, earth: Sequence[Any], ns: Any) -> list[Any]:
    """Return a vector of the earth's axes in the axes of a level vehicle."""
    c, s = ns.cos(psi), ns.sin(psi)
    return [earth[0] * c + earth[1] * s, earth[1] * c - earth[0] * s, earth[2]]


def heading_in_earth(psi: Any, body: Sequence[Any], ns: Any) -> list[Any]:
    """Return a vector of the axes of a level vehicle in the earth's."""
    c, s = ns.cos(psi), ns.sin(psi)
    return [body[0] * c - body[1] * s, body[0] * s + body[1] * c, body[2]]


def euler_rotation(phi: Any, theta: Any, psi: Any, ns: Any) -> Rotation:
    """Return R (3x3) of roll phi, pitch theta and heading psi [rad]."""
    cphi, sphi = ns.cos(phi), ns.sin(phi)
    cth, sth = ns.cos(theta), ns.sin(theta)
    cpsi, spsi = ns.cos(psi), ns.sin(psi)
    return [
        [cpsi * cth, cpsi * sth * sphi - spsi * cphi, spsi * sphi + cpsi * cphi * sth],
        [spsi * cth, cpsi * cphi + sphi * sth * spsi, sth * spsi * cphi - cpsi * sphi],
        [-sth, cth * sphi, cth * cphi],
    ]


def euler_rates(phi: Any, theta: Any, omega: Sequence[Any], ns: Any) -> list[Any]:
    """Return (phi', theta', psi') of the angular velocity omega = (p, q, r) [rad/s]."""
    p, q, r = omega
    cphi, sphi, cth = ns.cos(phi), ns.sin(phi), ns.cos(theta)
    turn = (q * sphi + r * cphi) / cth
    return [p + turn * ns.sin(theta), q * cphi - r * sphi, turn]


def quaternion_rotation(q: Sequence[Any]) -> Rotation:
    """Return R (3x3) of q/|q|, q = (q0, q1, q2, q3) with q0 the real part."""
    q0, q1, q2, q3 = q
    two = 2.0 / (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    return [
        [
            1.0 - two * (q2 * q2 + q3 * q3),
            two * (q1 * q2 - q3 * q0),
            two * (q1 * q3 + q2 * q0),
        ],
        [
            two * (q1 * q2 + q3 * q0),
            1.0 - two * (q1 * q1 + q3 * q3),
            two * (q2 * q3 - q1 * q0),
        ],
        [
            two * (q1 * q3 - q2 * q0),
            two * (q2 * q3 + q1 * q0),
            1.0 - two * (q1 * q1 + q2 * q2),
        ],
    ]


def quaternion_rates(q: Sequence[Any], omega: Sequence[Any]) -> list[Any]:
    """Return q' (4) of the angular velocity omega = (p, q, r) [rad/s], with the norm kept."""
    q0, q1, q2, q3 = q
    p, s, r = (0.5 * rate for rate in omega)
    back = 0.5 * QUATERNION_RATE * (1.0 - (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3))
    return [
        back * q0 - p * q1 - s * q2 - r * q3,
        back * q1 + p * q0 + r * q2 - s * q3,
        back * q2 + s * q0 - r * q1 + p * q3,
        back * q3 + r * q0 + s * q1 - p * q2,
    ]


def euler_angles(q: Sequence[Any], ns: Any) -> list[Any]:
    """Return roll, pitch and heading [rad] of a quaternion."""
    R = quaternion_rotation(q)
    # by rounding, the sine may lie just beyond 1
    sine = ns.max(-1.0, ns.min(1.0, -R[2][0]))
    return [ns.atan2(R[2][1], R[2][2]), ns.asin(sine), ns.atan2(R[1][0], R[0][0])]


def in_body(R: Rotation, earth: Sequence[Any]) -> list[Any]:
    """Return R' earth: a vector of the earth's axes, in body axes."""
    return [R[0][i] * earth[0] + R[1][i] * earth[1] + R[2][i] * earth[2] for i in range(3)]


def in_earth(R: Rotation, body: Sequence[Any]) -> list[Any]:
    """Return R body: a vector of body axes, in the earth's."""
    return [R[i][0] * body[0] + R[i][1] * body[1] + R[i][2] * body[2] for i in range(3)]


def cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Return the vector product a x b."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
