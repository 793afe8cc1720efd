"""Minimise a function with kinks: BFGS with a weak Wolfe line search.

A maximum of smooth functions, such as a largest singular value or a rightmost root, is smooth
almost everywhere, and its minimum lies at a kink as a rule. BFGS with steps that satisfy the
weak Wolfe conditions converges there in practice, and needs one gradient per point only (A. S.
Lewis, M. L. Overton, Math. Program. 141 (2013) 135; HIFOO and TDS-CONTROL do the same).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import still_working

Reals = NDArray[np.float64]
Function = Callable[[Reals], tuple[float, Reals]]

_DECREASE, _CURVATURE = 1e-4, 0.5
_LINE = 30  # evaluations of one line search
_WINDOW, _ENOUGH = 8, 1e-4  # a decrease in so many steps below which they end


class Minimum(NamedTuple):
    """The best point found, its value, and the number of evaluations."""

    x: Reals
    value: float
    evaluations: int


def minimised(
    function: Function, start: Reals, *, evaluations: int, below: float = -np.inf
) -> Minimum:
    """Minimise a function from `start`, a point where it is finite.

    Parameters
    ----------
    function : returns the value, which may be infinite, and the gradient.
    evaluations : how many at most; with it the result does not depend on the machine's speed.
    below : a value at which to stop.
    """
    x, (value, gradient) = start, function(start)
    inverse, used, first, passed = np.eye(x.size), 1, True, [value]
    while used < evaluations and value >= below:
        still_working()
        direction = -inverse @ gradient
        slope = float(gradient @ direction)
        if not slope < 0:
            if first or not gradient.any():
                break
            inverse, first = np.eye(x.size), True
            continue
        # before anything is known of the curvature: a tenth of the unit in which x counts
        t = 0.1 / max(float(np.linalg.norm(direction)), 1e-300) if first else 1.0
        line = _line_search(function, x, value, direction, slope, t)
        used += line.evaluations
        if line.x is None:
            if first:
                break
            inverse, first = np.eye(x.size), True  # once more along the gradient
            continue
        change = line.gradient - gradient
        step = line.x - x
        curvature = float(change @ step)
        passed.append(line.value)
        small = len(passed) > _WINDOW and passed[-1 - _WINDOW] - passed[-1] <= _ENOUGH
        if curvature > 1e-14 * float(np.linalg.norm(change) * np.linalg.norm(step)):
            if first:
                inverse *= curvature / float(change @ change)
            moved = inverse @ change
            inverse += (
                (1 + float(change @ moved) / curvature) * np.outer(step, step)
                - np.outer(moved, step)
                - np.outer(step, moved)
            ) / curvature
        x, value, gradient, first = line.x, line.value, line.gradient, False
        if small:
            break
    return Minimum(x, value, used)


class _Step(NamedTuple):
    x: Reals | None
    value: float
    gradient: Reals
    evaluations: int


def _line_search(
    function: Function, x: Reals, value: float, direction: Reals, slope: float, t: float
) -> _Step:
    """Return a step with the weak Wolfe conditions, or the best decrease that was met."""
    low, high = 0.0, np.inf
    best = _Step(None, value, direction, 0)
    for used in range(1, _LINE + 1):
        there = x + t * direction
        there_value, gradient = function(there)
        if there_value > value + _DECREASE * t * slope or not np.isfinite(there_value):
            high = t
        elif float(gradient @ direction) < _CURVATURE * slope:
            low = t
            if there_value < best.value:
                best = _Step(there, there_value, gradient, used)
        else:
            return _Step(there, there_value, gradient, used)
        t = 2 * low if high == np.inf else 0.5 * (low + high)
        if high - low <= 1e-12 * high:
            break
    return best._replace(evaluations=used)
