"""E and H contain the vehicle over the whole box, and not much more than the vehicle."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import flint
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.hinf.problem import Envelope, Scaling, auv_uncertainty, quadratic_part
from cosim.models import TABLE_1, thrust_map, vehicle_derivatives, velocity_coefficients

BOXES = (
    Envelope(0.3, 0.3, 0.2, 0.06, 0.35),
    Envelope(0.15, 0.15, 0.1, 0.05, 0.175),
    Envelope(2.0, 0.01, 0.5, 0.4, math.pi),
)
SCALINGS = (Scaling(), Scaling((1.0, 2.0, 0.3, 0.1), (5.0, 0.2, 1.0, 1.0), 3.0))
PRINTED = (
    {"vv": 0.124, "ww": 0.397, "rr": 0.262, "vr": 1.153},
    {"ur": -0.353, "wr": -0.141, "uv": -0.149, "vw": 0.095},
    {"vv": -0.041, "rr": -0.125, "uw": -0.181, "vr": 0.144},
    {"ur": -0.313, "wr": 0.138, "uv": -0.031, "vw": -0.095},
)
"""Quadratic terms of f(x), as printed below Eq. (4)."""


def _delta_a(psi: float, nu: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """dA(x) (8, 8), from J(psi) - I and Q(nu)."""
    dA = np.zeros((8, 8))
    c, s = math.cos(psi) - 1.0, math.sin(psi)
    dA[:2, 4:6] = [[c, -s], [s, c]]
    dA[4:, 4:] = np.array(quadratic_part(nu, velocity_coefficients(TABLE_1)), dtype=float)
    return dA


def _f_matrix(
    dA: NDArray[np.float64], E: NDArray[np.float64], H: NDArray[np.float64]
) -> NDArray[np.float64]:
    """F (6, 6) with E F H = dA; E has independent columns, H independent blocks of rows."""
    F = np.zeros((6, 6))
    F[:2, :2] = dA[:2, 4:6] / E[0, 0] / H[0, 4]
    F[2:, 2:] = dA[4:, 4:] / np.diag(E[4:, 2:])[:, None] / np.diag(H[2:, 4:])
    return F


@pytest.mark.parametrize("scaling", SCALINGS)
@pytest.mark.parametrize("box", BOXES)
def test_the_factors_hold_at_every_vertex_exactly(box: Envelope, scaling: Scaling) -> None:
    """|F2| <= 1 at all 16 vertices, from E and H as their doubles, by rational arithmetic.

    An exact characteristic polynomial, another way than the code's elimination: I - F2 F2'
    is positive semidefinite exactly if the coefficients alternate in sign weakly.
    """
    bounds = auv_uncertainty(box, TABLE_1, scaling)
    coefficients = velocity_coefficients(TABLE_1)
    for signs in itertools.product((1, -1), repeat=4):
        nu = [Fraction(b) * s for b, s in zip(box.velocity, signs, strict=True)]
        Q = quadratic_part(nu, coefficients)
        entries = [
            Q[i][j] / Fraction(bounds.E[4 + i, 2 + i]) / Fraction(bounds.H[2 + j, 4 + j])
            for i in range(4)
            for j in range(4)
        ]
        F2 = flint.fmpq_mat(4, 4, [flint.fmpq(x.numerator, x.denominator) for x in entries])
        one = flint.fmpq_mat(4, 4, [int(i == j) for i in range(4) for j in range(4)])
        polynomial = (one - F2 * F2.transpose()).charpoly().coeffs()
        assert all((-1) ** (4 - k) * c >= 0 for k, c in enumerate(polynomial))
    # the kinematic block: |J(psi) - I| = 2 sin(psi/2), enclosed in a ball
    assert bounds.E[0, 0] * bounds.H[0, 4] >= 2 * (flint.arb(box.psi) / 2).sin()


@settings(max_examples=200, deadline=None)
@given(share=st.tuples(*[st.floats(-1.0, 1.0)] * 5), box=st.sampled_from(BOXES))
def test_every_state_in_the_box_is_contained(
    share: tuple[float, float, float, float, float], box: Envelope
) -> None:
    """DA(x) = E F H with |F| <= 1 at any point of the box, not only at its corners."""
    u, v, w, r = (a * b for a, b in zip(share, box.velocity, strict=False))
    bounds = auv_uncertainty(box, TABLE_1)
    dA = _delta_a(share[4] * box.psi, (u, v, w, r))
    F = _f_matrix(dA, bounds.E, bounds.H)
    assert pytest.approx(dA, abs=1e-14) == bounds.E @ F @ bounds.H
    assert np.linalg.norm(F, 2) <= 1.0 + 1e-12


@settings(max_examples=100, deadline=None)
@given(x=st.tuples(*[st.floats(-2.0, 2.0)] * 8))
def test_the_uncertain_part_is_exactly_f_minus_its_linear_part(x: tuple[float, ...]) -> None:
    """f(x) - A x = dA(x) x: nothing of the vehicle's equations is left out of E F H."""
    p = {**TABLE_1, "damping.u": 0.0, "damping.v": 0.0, "damping.w": 0.0, "damping.r": 0.0}
    zero = (0.0,) * 4
    f = np.array(vehicle_derivatives(x, zero, zero, zero, p, thrust_map(p), math))
    linear = np.concatenate([x[4:], zero])
    dA = _delta_a(x[3], (x[4], x[5], x[6], x[7]))
    assert dA @ np.array(x) == pytest.approx(f - linear, abs=1e-12)


def test_the_quadratic_part_is_the_paper_s() -> None:
    """Q(nu) nu has the printed coefficients to their digits (uv of the yaw row: -0.0300)."""
    coefficients = velocity_coefficients(TABLE_1)

    def q(*nu: int) -> list[float]:
        Q = quadratic_part(nu, coefficients)
        return [float(sum(a * b for a, b in zip(row, nu, strict=True))) for row in Q]

    axes = [[int(i == j) for j in range(4)] for i in range(4)]
    for row, printed in enumerate(PRINTED):
        for i, j in itertools.combinations_with_replacement(range(4), 2):
            name = "uvwr"[i] + "uvwr"[j]
            square = q(*axes[i])[row]
            both = q(*map(sum, zip(axes[i], axes[j], strict=True)))[row]
            value = square if i == j else both - square - q(*axes[j])[row]
            within = 1.1e-3 if (row, name) == (3, "uv") else 6e-4
            assert value == pytest.approx(printed.get(name, 0.0), abs=within)


@pytest.mark.parametrize("box", BOXES)
def test_the_bounds_are_attained(box: Envelope) -> None:
    """Both blocks of F reach norm 1 to ten digits in the box: the proof gives nothing away."""
    bounds = auv_uncertainty(box, TABLE_1)
    worst = [0.0, 0.0]
    for signs in itertools.product((1, -1), repeat=4):
        u, v, w, r = (a * b for a, b in zip(signs, box.velocity, strict=True))
        F = _f_matrix(_delta_a(box.psi, (u, v, w, r)), bounds.E, bounds.H)
        worst[0] = max(worst[0], float(np.linalg.norm(F[:2, :2], 2)))
        worst[1] = max(worst[1], float(np.linalg.norm(F[2:, 2:], 2)))
    assert worst == pytest.approx([1.0, 1.0], abs=1e-10)


@pytest.mark.parametrize(
    ("bounds", "name"),
    [
        ((0.0, 1.0, 1.0, 1.0, 1.0), "u"),
        ((1.0, -1.0, 1.0, 1.0, 1.0), "v"),
        ((1.0, 1.0, math.inf, 1.0, 1.0), "w"),
        ((1.0, 1.0, 1.0, math.nan, 1.0), "r"),
        ((1.0, 1.0, 1.0, 1.0, 3.2), "psi"),
    ],
)
def test_empty_envelope_is_refused(
    bounds: tuple[float, float, float, float, float], name: str
) -> None:
    """Each bound is a positive number, and psi goes no further than half a turn."""
    with pytest.raises(InputError, match=rf"envelope\.{name}"):
        Envelope(*bounds)
