"""A plain integrator for loops with ages that vary and an uncertainty that turns: for tests.

Heun's method on a fixed grid, delayed values interpolated linearly: second order, and nothing
shared with the simulator or with any proof.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.models import DelaySystem

Array = NDArray[np.float64]


def integrate(
    system: DelaySystem,
    K: Array,
    start: Array,
    end: float,
    *,
    ages: Sequence[Callable[[float], float]],
    F: Callable[[float], Array] | None = None,
    w: Callable[[float], Array] | None = None,
    step: float = 2e-3,
) -> tuple[Array, Array, Array]:
    """Times, x and u of the loop from a constant history."""
    count = math.ceil(end / step)
    t = step * np.arange(count + 1)
    x = np.zeros((count + 1, len(start)))
    x[0] = start

    def late(k: int, s: float, age: float) -> Array:
        """x(s - age), known up to row k."""
        place = (s - age) / step
        if place <= 0:
            return start
        i = min(int(place), k - 1) if k else 0
        return x[i] + (place - i) * (x[i + 1] - x[i]) if k else start

    def control(now: Array, lates: Sequence[Array]) -> Array:
        acts = [y for y, delay in zip(lates, system.delays, strict=True) if delay.feedback]
        return np.asarray(K @ (acts[0] if acts else now))

    def rate(k: int, s: float, now: Array) -> tuple[Array, Array]:
        lates = [late(k, s, age(s)) if age(s) > 0 else now for age in ages]
        u = control(now, lates)
        total = system.A @ now + system.B @ u
        inner = system.H @ now
        for y, delay in zip(lates, system.delays, strict=True):
            total = total + delay.A @ y
            inner = inner + delay.H @ y
        if F is not None:
            total = total + system.E @ (F(s) @ inner)
        if w is not None:
            total = total + system.C @ w(s)
        return total, u

    u = np.zeros((count + 1, K.shape[0]))
    for k in range(count):
        first, u[k] = rate(k, t[k], x[k])
        x[k + 1] = x[k] + step * first  # a predictor, and what an age below a step looks up
        second, _ = rate(k + 1, t[k + 1], x[k + 1])
        x[k + 1] = x[k] + step / 2 * (first + second)
    u[-1] = rate(count, t[-1], x[-1])[1]
    return t, x, u


def sawtooth(d: float, period: float) -> Callable[[float], float]:
    """Ages of a sampled signal held: from d - period up to d, again and again."""
    return lambda s: d - period + s % period


def turning(rows: int, columns: int, speed: float, phase: float = 0.0) -> Callable[[float], Array]:
    """F(t) of norm one: the identity's part of a rotation, or its negative, as time goes."""
    return lambda s: math.cos(speed * s + phase) * np.eye(rows, columns)
