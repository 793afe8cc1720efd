"""The vehicle's equations against the paper's printed numbers and Eq. (3)."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import symengine

from cosim.models import (
    STATE,
    TABLE_1,
    hydrodynamic_force,
    inertia,
    thrust_map,
    vehicle_derivatives,
    velocity_coefficients,
)

PARAMETERS = {**TABLE_1, **{f"damping.{axis}": 0.04 + 0.01 * i for i, axis in enumerate("uvwr")}}

PRINTED_F = (
    {"vv": "0.124", "ww": "0.397", "rr": "0.262", "vr": "1.153"},
    {"ur": "-0.353", "wr": "-0.141", "uv": "-0.149", "vw": "0.095"},
    {"vv": "-0.041", "rr": "-0.125", "uw": "-0.181", "vr": "0.144"},
    {"ur": "-0.313", "wr": "0.138", "uv": "-0.031", "vw": "-0.095"},
)
"""Rows 5 to 8 of f(x) below Eq. (4), as printed."""

NAMED_EXCEPTION = (3, "uv")


def printed() -> list[Any]:
    return [
        pytest.param(row, product, text, id=f"{'uvwr'[row]}-{product}")
        for row, entries in enumerate(PRINTED_F)
        for product, text in entries.items()
    ]


def decimals() -> dict[str, Fraction]:
    """Table 1 as the decimals it is printed in, not their doubles."""
    return {name: Fraction(repr(value)) for name, value in TABLE_1.items()}


@pytest.mark.parametrize(("row", "product", "text"), printed())
def test_coefficient_of_f_is_the_printed_one(row: int, product: str, text: str) -> None:
    """15 of the 16 printed coefficients come out to the three digits given; uv in r does not."""
    value = velocity_coefficients(decimals())[row][product]
    if (row, product) == NAMED_EXCEPTION:
        assert f"{float(value):.4f}" == "-0.0300"
        return
    assert abs(value - Fraction(text)) <= Fraction("0.0005")


def test_f_has_no_products_beyond_the_printed_ones() -> None:
    """Sway and yaw share their products through M; u and w have exactly those printed."""
    rows = velocity_coefficients(decimals())
    assert [set(row) for row in rows] == [set(row) for row in PRINTED_F]
    assert sum(len(row) for row in rows) == 16


def test_thrust_map_is_the_printed_one() -> None:
    """Eq. (4)'s matrix to the digits printed, its off-diagonal with a plus sign."""
    b = np.array(thrust_map(TABLE_1), dtype=float)
    assert [f"{value:.3e}" for value in np.diag(b)[:2]] == ["1.661e-04", "1.049e-04"]
    assert [f"{value:.2e}" for value in np.diag(b)[2:]] == ["4.29e-05", "4.84e-05"]
    assert f"{b[1, 3]:+.2e}" == f"{b[3, 1]:+.2e}" == "+2.40e-06"
    others = b - np.diag(np.diag(b))
    others[1, 3] = others[3, 1] = 0.0
    assert not others.any()


def test_thrust_map_inverts_the_mass_matrix() -> None:
    """B M = I, by numpy."""
    m = np.array(inertia(TABLE_1), dtype=float)
    b = np.array(thrust_map(TABLE_1), dtype=float)
    assert np.allclose(b @ m, np.eye(4), rtol=0, atol=1e-14)


def test_motion_satisfies_equation_3_as_printed() -> None:
    """Both sides of Eq. (3), written out row by row with accelerations on either side."""
    p: Any = SimpleNamespace(**{n.replace("hydro.", ""): v for n, v in TABLE_1.items()})
    m, iz, rho, L = 5454.0, 13587.0, 1000.0, 5.3
    generator = np.random.default_rng(7)
    for _ in range(20):
        state = generator.normal(size=8)
        tau = generator.normal(size=4) * 1000
        still = {**TABLE_1, **dict.fromkeys([f"damping.{a}" for a in "uvwr"], 0.0)}
        rate = vehicle_derivatives(state, [0.0] * 4, tau, [0.0] * 4, still, thrust_map(still), math)
        u, v, w, r = state[4:]
        du, dv, dw, dr = rate[4:]
        l2, l3, l4, l5 = (rho / 2 * L**k for k in (2, 3, 4, 5))
        surge = l4 * p.X_rr * r**2 + l3 * (p.X_udot * du + p.X_vr * v * r)
        surge += l2 * (p.X_vv * v**2 + p.X_ww * w**2) + tau[0]
        sway = l4 * p.Y_rdot * dr + l3 * (p.Y_vdot * dv + p.Y_ur * u * r + p.Y_wr * w * r)
        sway += l2 * (p.Y_uv * u * v + p.Y_vw * v * w) + tau[1]
        heave = l4 * p.Z_rr * r**2 + l3 * (p.Z_wdot * dw + p.Z_vr * v * r)
        heave += l2 * (p.Z_uw * u * w + p.Z_vv * v**2) + tau[2]
        yaw = l5 * p.N_rdot * dr + l4 * (p.N_vdot * dv + p.N_ur * u * r + p.N_wr * w * r)
        yaw += l3 * (p.N_uv * u * v + p.N_vw * v * w) + tau[3]
        left = [m * (du - v * r), m * (dv + u * r), m * dw, iz * dr]
        assert np.allclose(left, [surge, sway, heave, yaw], rtol=1e-12, atol=1e-9)


def test_kinematics_is_a_rotation() -> None:
    """Eq. (2) in full: the earth velocity is the body velocity turned by psi, as a complex."""
    state = [1.0, 2.0, 3.0, 2.2, 0.7, -0.4, 0.2, 0.3]
    rate = vehicle_derivatives(
        state, [0.0] * 4, [0.0] * 4, [0.0] * 4, PARAMETERS, thrust_map(PARAMETERS), math
    )
    turned = complex(0.7, -0.4) * complex(math.cos(2.2), math.sin(2.2))
    assert complex(rate[0], rate[1]) == pytest.approx(turned, abs=1e-15)
    assert rate[2:4] == [0.2, 0.3]


def test_damping_acts_on_the_delayed_speed_and_disturbance_is_an_acceleration() -> None:
    """-diag(a) nu(t-d) + w is added to nu' of the undamped vehicle, and to nothing else."""
    b = thrust_map(PARAMETERS)
    state, late, w = [0.1 * i for i in range(8)], [1.0, -2.0, 3.0, -4.0], [0.5, 0.6, 0.7, 0.8]
    bare = vehicle_derivatives(state, [0.0] * 4, [9.0] * 4, [0.0] * 4, PARAMETERS, b, math)
    full = vehicle_derivatives(state, late, [9.0] * 4, w, PARAMETERS, b, math)
    a = [PARAMETERS[f"damping.{axis}"] for axis in "uvwr"]
    expected = [0.0] * 4 + [-a[i] * late[i] + w[i] for i in range(4)]
    assert np.subtract(full, bare) == pytest.approx(expected, abs=1e-14)


def test_floats_arrays_and_symbols_agree() -> None:
    """One source: the same numbers whether floats, arrays or symbols went through it."""
    b = thrust_map(PARAMETERS)
    points = np.random.default_rng(3).normal(size=(20, 50))
    arrays = vehicle_derivatives(
        points[:8], points[8:12], points[12:16], points[16:], PARAMETERS, b, np
    )
    symbols = symengine.symbols("s0:20")
    written = vehicle_derivatives(
        symbols[:8], symbols[8:12], symbols[12:16], symbols[16:], PARAMETERS, b, symengine
    )
    compiled = symengine.Lambdify(symbols, written)
    for k in range(50):
        s = [float(value) for value in points[:, k]]
        floats = vehicle_derivatives(s[:8], s[8:12], s[12:16], s[16:], PARAMETERS, b, math)
        assert np.array([row[k] for row in arrays]) == pytest.approx(floats, rel=1e-13, abs=1e-13)
        assert np.asarray(compiled(s)) == pytest.approx(floats, rel=1e-12, abs=1e-12)


def test_parameters_may_be_symbols_too() -> None:
    """The force law is polynomial in every parameter: with symbols for Table 1 as well."""
    names = {name: symengine.Symbol(name.replace(".", "_")) for name in TABLE_1}
    nu = symengine.symbols("u v w r")
    force = hydrodynamic_force(tuple(nu), names)
    values = {names[name]: TABLE_1[name] for name in TABLE_1}
    values |= dict(zip(nu, (0.3, -0.2, 0.1, 0.05), strict=True))
    got = [float(symengine.sympify(row).subs(values)) for row in force]
    assert got == pytest.approx(hydrodynamic_force((0.3, -0.2, 0.1, 0.05), TABLE_1), rel=1e-13)


def test_state_names_are_those_of_the_vector() -> None:
    """Position first, then speed, as Eq. (4) orders x."""
    assert [name.split(".")[1] for name in STATE] == ["x", "y", "z", "psi", "u", "v", "w", "r"]
