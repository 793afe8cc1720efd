"""Simulation of section 5: Eq. (7) with u = K x, integrated with its delay.

The integrals of z'z and w'w are two more states; they give the gain of the run. From the zero
state it is a lower bound of the H-infinity norm, by (ii).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.models import (
    DelayLine,
    feedback_command,
    linear_derivatives,
    linear_output,
    paper_example as example,
)

_LETTERS = ("A", "A1", "B", "C", "D", "D1", "D2", "E", "H", "H1")
_MATRICES = {letter: getattr(example, letter) for letter in _LETTERS}


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A simulated run.

    t : (N,) [s]. x : (N, 2). u : (N,). w : (N,).
    gain : sqrt(int z'z / int w'w) over the whole run.
    """

    t: NDArray[np.float64]
    x: NDArray[np.float64]
    u: NDArray[np.float64]
    w: NDArray[np.float64]
    gain: float


def simulate(
    *,
    initial: tuple[float, float],
    frequency: float,
    amplitude: float,
    end: float,
    points: int,
    step: float = 0.01,
) -> SimulatedRun:
    """Simulate the printed gain at the printed delay, with w = sin(frequency t).

    Parameters
    ----------
    initial : x(t) for t <= 0.
    frequency : frequency of the disturbance [rad/s].
    amplitude : amplitude of F(t) = amplitude sin(t) I2.
    end : end of the run [s].
    points : number of instants that are returned, from 0 to `end`.
    step : largest internal step [s].
    """
    uncertainty = (amplitude, example.F_OMEGA)

    def disturbance(t: float) -> list[float]:
        return [math.sin(frequency * t)]

    def control(x: list[float]) -> list[float]:
        return feedback_command([example.PRINTED_K], x[:2], (0.0, 0.0), None)

    def rate(t: float, state: list[float], lagged: list[list[float]]) -> list[float]:
        x, delayed = state[:2], [lagged[0][:2]]
        u, w = control(x), disturbance(t)
        slope = linear_derivatives(t, x, delayed, u, w, _MATRICES, uncertainty, math)
        z = linear_output(x, u, w, _MATRICES)
        return [*slope, sum(v * v for v in z), sum(v * v for v in w)]

    line = DelayLine([*initial, 0.0, 0.0], [example.d], step)
    t = [end * k / (points - 1) for k in range(points)]
    states = [list(line.x)]
    for moment in t[1:]:
        line.advance(moment, rate, jump=False)
        states.append(list(line.x))
    x = np.array(states)
    return SimulatedRun(
        t=np.array(t),
        x=x[:, :2],
        u=np.array([control(row)[0] for row in states]),
        w=np.array([disturbance(moment)[0] for moment in t]),
        gain=math.sqrt(states[-1][2] / states[-1][3]),
    )
