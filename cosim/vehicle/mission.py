"""Choose set-points and sea so that a vehicle stays inside its envelope and limits.

The nominal pair of vehicle and observer answers linearly: its response to set-points that go back
to the trim along the path of the flight, and to a wave of the peak period, are computed once and
scaled to the share of envelope and limits that is asked for. The flight itself is nonlinear, and
reports what it used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.delay_lti import close
from cosim.vehicle.flight_plan import FlightSettings
from cosim.vehicle.flight_scenario import PATH_ENDS, Mission

if TYPE_CHECKING:
    from cosim.hinf import Result

Reals = NDArray[np.float64]

_MOST_METRES, _MOST_RADIANS = 5.0, 0.3
_ERROR = 0.1  # of the first estimate, as a share of the offset


def plan_mission(
    design: Result,
    states: Sequence[str],
    disturbances: Sequence[str],
    envelope: Mapping[str, float],
    limits: Sequence[float],
    settings: FlightSettings,
) -> Mission:
    """Return set-points and sea that together use the share of envelope and limits asked for.

    Parameters
    ----------
    states, disturbances : names of x and w.
    envelope : bound of the deviation of a state, by its name.
    limits : bound of each control u.
    """
    positions = [i for i, name in enumerate(states) if name.startswith("eta.")]
    free = [i for i in positions if states[i] not in envelope or _is_heading(states[i])]
    bounds = np.array([envelope.get(name, np.inf) for name in states])
    sizes = np.array([_MOST_RADIANS if _is_angle(states[i]) else _MOST_METRES for i in free])
    times = np.arange(0.0, settings.duration, settings.step)
    offsets: dict[int, float] = {}
    if free:
        loop = _loop(design, free)
        along = -_along(times / (PATH_ENDS * settings.duration))  # from 1 back to 0, less the start
        signs = np.array([(-1.0) ** k for k in range(len(free))])
        used = _use(loop, times, along[:, None] * (signs * sizes), bounds, limits, free)
        # a position may go as far as it likes, but an angle no further than its bound
        most = min([1.0] + [0.5 * bounds[i] / s for i, s in zip(free, sizes, strict=True)])
        share = min(most, 0.6 * settings.use / used) if used > 0 else most
        offsets = {
            i + 1: _rounded(float(sign * size * share))
            for i, sign, size in zip(free, signs, sizes, strict=True)
        }
    height = _wave_height(design, disturbances, bounds, limits, settings)
    errors = {i: _rounded(_ERROR * value) for i, value in offsets.items() if abs(value) > 0}
    return Mission(offsets, errors, height)


def _is_angle(name: str) -> bool:
    return name in ("eta.phi", "eta.theta", "eta.psi")


def _is_heading(name: str) -> bool:
    return name == "eta.psi"


def _rounded(value: float) -> float:
    """Return a value with two digits, towards zero: it is read by people."""
    if value == 0.0:
        return 0.0
    scale = 10.0 ** (np.floor(np.log10(abs(value))) - 1)
    return float(f"{np.trunc(value / scale) * scale:.6g}")


def _along(share: Reals) -> Reals:
    """Return how much of the path is behind, as `[reference]` interpolates smoothly."""
    s = np.clip(share, 0.0, 1.0)
    along: Reals = s * s * (3.0 - 2.0 * s)
    return along


class _Loop:
    """The nominal pair with further inputs: outputs are x, then u."""

    def __init__(self, design: Result, inputs: Reals, direct: Reals) -> None:
        pair, gain = design.pair.system, design.pair.gain
        n, m = design.system.B.shape
        wide = len(pair.A)
        states = np.hstack([np.eye(n), np.zeros((n, wide - n))])
        controls = np.zeros((m, gain.shape[0]))
        controls[:, :m] = np.eye(m)
        system = replace(
            pair,
            C=inputs,
            D=np.vstack([states, np.zeros((m, wide))]),
            D1=np.vstack([np.zeros((n, inputs.shape[1])), direct]),
            D2=np.vstack([np.zeros((n, gain.shape[0])), controls]),
        )
        self._loop = close(system, gain)
        self.states = n

    def greatest(self, times: Reals, signal: Reals) -> Reals:
        """Return the greatest magnitude of each output for an input (k, q) at equal steps.

        Exact in what is not delayed, with late terms and inputs constant over a step.
        """
        loop, step = self._loop, float(times[1] - times[0])
        wide = len(loop.A[0])
        block = np.zeros((2 * wide, 2 * wide))
        block[:wide, :wide], block[:wide, wide:] = loop.A[0], np.eye(wide)
        moved = scipy.linalg.expm(step * block)
        ahead, by_input = moved[:wide, :wide], moved[:wide, wide:]
        steps = [round(d / step) for d in loop.delays[1:]]
        x = np.zeros((len(times) + 1, wide))
        most = np.zeros(len(loop.D[0]))
        for k, w in enumerate(signal):
            old = [x[k - n] if k >= n else x[0] for n in steps]
            y = loop.D[0] @ x[k] + loop.D1 @ w
            driven = loop.C @ w
            for A, D, then in zip(loop.A[1:], loop.D[1:], old, strict=True):
                y, driven = y + D @ then, driven + A @ then
            most = np.maximum(most, np.abs(y))
            x[k + 1] = ahead @ x[k] + by_input @ driven
        return most

    def at(self, omega: float) -> Reals:
        """Return the magnitudes of the response to sinusoids, (outputs, inputs)."""
        return np.asarray(np.abs(self._loop.transfer(omega)))


def _loop(design: Result, free: Sequence[int]) -> _Loop:
    """Return the pair with the changes of set-points as inputs: u = K (xh - r)."""
    n = len(design.system.A)
    change = -design.K[:, free]
    rest = np.zeros((len(design.pair.system.A) - n, len(free)))
    return _Loop(design, np.vstack([design.system.B @ change, rest]), change)


def _use(
    loop: _Loop,
    times: Reals,
    signal: Reals,
    bounds: Reals,
    limits: Sequence[float],
    free: Sequence[int] = (),
) -> float:
    """Return the greatest share of envelope and limits that a signal takes."""
    most = loop.greatest(times, signal)
    chosen = np.isin(np.arange(loop.states), free)  # their offset is chosen, not answered
    shares = [*(most[: loop.states] / bounds)[~chosen], *(most[loop.states :] / np.array(limits))]
    return float(max(shares, default=0.0))


def _wave_height(
    design: Result,
    disturbances: Sequence[str],
    bounds: Reals,
    limits: Sequence[float],
    settings: FlightSettings,
) -> float:
    """Return the height of the sea [m] whose peak wave takes its share; 0 where none acts."""
    acting = [
        k for k, name in enumerate(disturbances) if name in ("disturbance.u", "disturbance.v")
    ]
    if not acting:
        return 0.0
    C = design.pair.system.C[:, : len(disturbances)]
    direct = np.zeros((design.system.B.shape[1], C.shape[1]))
    omega = 2 * np.pi / Mission.wave_period
    most = _Loop(design, C, direct).at(omega)[:, acting].sum(axis=1)
    n = len(design.system.A)
    shares = [*(most[:n] / bounds), *(most[n:] / np.array(limits))]
    per_acceleration = max(shares)
    # irregular: the greatest of some twenty waves is twice the significant amplitude Hs/2
    per_height = omega**2 * np.exp(-(omega**2) * Mission.wave_depth / 9.81)
    height = 0.4 * settings.use / (per_acceleration * per_height) if per_acceleration else 0.0
    return _rounded(min(height, 2.0))
