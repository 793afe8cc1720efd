"""The vehicle within its thrust: what is proved of the control, next to what is flown."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from cosim.hinf import Result, auv_system, check_certificate, design
from cosim.hinf.problem import DEFAULT_ENVELOPE, DEFAULT_K1, DEFAULT_K2
from cosim.models import TABLE_1, inertia, thrust_map, vehicle_derivatives

OFFSET = (1.0, 1.0, 0.6, 0.15, 0.0, 0.0, 0.0, 0.0)
"""Where a flight may start [m, m, m, rad, m/s, ...]."""
LIMIT = (0.25, 0.25, 0.25, 0.2)
"""[m/s^2, m/s^2, m/s^2, rad/s^2]"""


@pytest.fixture(scope="module")
def found() -> Result:
    """The design for the link, its peak of u proved from the offset."""
    return design(auv_system(), DEFAULT_K1, DEFAULT_K2, peak_control=LIMIT, offset=OFFSET)


def _simulate(K: np.ndarray, start: np.ndarray, age: float, end: float = 40.0) -> np.ndarray:
    """(eta, nu, u) over time: the vehicle of Eqs. (1)-(4) in full, Heun, samples held."""
    step, hold_steps = 0.01, round(0.25 / 0.01)
    late, state_late = round(age / step), round(0.5 / step)
    p = dict(TABLE_1) | dict.fromkeys(("damping.u", "damping.v", "damping.w", "damping.r"), 0.05)
    b, M = thrust_map(p), np.array(inertia(p))
    count = round(end / step)
    nothing = [0.0] * 4
    x, u = np.tile(start, (count + 1, 1)), np.zeros((count + 1, 4))
    for k in range(count):
        # a sample every 0.25 s, late, then held: its age runs from `age` - 0.25 to `age`
        sampled = (k // hold_steps) * hold_steps - late + hold_steps
        u[k] = K @ x[max(min(sampled, k), 0)]
        tau = list(M @ u[k])

        def rate(state: np.ndarray, at: int, tau: list[float] = tau) -> np.ndarray:
            delayed = list(x[max(at - state_late, 0)][4:])
            return np.array(vehicle_derivatives(list(state), delayed, tau, nothing, p, b, math))

        first = rate(x[k], k)
        x[k + 1] = x[k] + step / 2 * (first + rate(x[k] + step * first, k + 1))
    u[-1] = u[-2]
    return np.hstack([x, u])


@pytest.mark.slow
def test_no_simulated_run_from_the_box_exceeds_the_proved_peak(found: Result) -> None:
    """All corners, three ages: |u| below its bounds, the bounds within 4 times what is flown.

    The flights stay inside the envelope that E and H are proved for, so the bounds are claimed.
    """
    peak = found.guarantees.peak_control
    assert peak is not None
    bounds = np.array([float(x) for x in peak.bounds])
    assert (bounds <= LIMIT).all()
    most, widest = np.zeros(4), np.zeros(5)
    for signs in itertools.product((1.0,), (1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
        start = np.array(OFFSET) * np.array([*signs, 0.0, 0.0, 0.0, 0.0])
        for age in (0.25, 1.25):
            trajectory = _simulate(found.K, start, age)
            most = np.maximum(most, np.abs(trajectory[:, 8:]).max(axis=0))
            nu_psi = np.abs(trajectory[:, [4, 5, 6, 7, 3]]).max(axis=0)
            widest = np.maximum(widest, nu_psi)
    e = DEFAULT_ENVELOPE
    assert (widest <= [e.u, e.v, e.w, e.r, e.psi]).all()
    assert (most <= bounds).all()
    assert bounds[0] <= 4 * most[0]


@pytest.mark.slow
def test_thrust_follows_from_acceleration(found: Result) -> None:
    """|u| bounds the forces through M: surge below 2 kN, from the certificate checked again."""
    assert check_certificate(found.certificate).valid
    peak = found.guarantees.peak_control
    assert peak is not None
    M = np.abs(np.array(inertia(TABLE_1)))
    force = M @ np.array([float(x) for x in peak.bounds])
    assert force[0] < 2000.0


@pytest.mark.slow
def test_a_tighter_limit_costs_gamma(found: Result) -> None:
    """Less thrust than the plain gain is proved with: kept, at a larger gamma."""
    peak = found.guarantees.peak_control
    assert peak is not None
    assert found.gamma is not None
    limits = [0.75 * float(x) for x in peak.bounds]
    tighter = design(auv_system(), DEFAULT_K1, DEFAULT_K2, peak_control=limits, offset=OFFSET)
    less = tighter.guarantees.peak_control
    assert less is not None
    assert tighter.gamma is not None
    assert all(float(x) <= limit for x, limit in zip(less.bounds, limits, strict=True))
    assert tighter.gamma > found.gamma
