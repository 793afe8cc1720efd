"""A nonlinear function over a box as linear with block-diagonal uncertainty: A + E F H, proved.

x' = f(x, x(t-d), u, o) about a point, with the deviation of x and of o within bounds:

    f - f0 = [f(o) - f0] + (A + dA) x + (A1 + dA1) x(t-d) + B u,   [dA dA1] = E F [H H1].

o are variables that nothing here controls: what they add that is not proportional to x is a
disturbance, of which each row is bounded.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.exact import rounded_up
from cosim.hinf.problem.affine_form import Bounds
from cosim.hinf.problem.dependence import DEPENDENCE, Dependence, variables_of
from cosim.hinf.problem.jacobians import PIECES, Function, change_of, jacobian, mean_jacobian
from cosim.hinf.problem.proved_uncertainty import (
    NormBlock,
    UncertainMatrix,
    centre_and_radius,
    loop_gains,
    order_of_variables,
    uncertain_matrix,
)

_CELLS = 64
_ROUGH = 4


@dataclass(frozen=True)
class Box:
    """The point that a function is linearised about, and the box around it.

    Attributes
    ----------
    names : of all variables, for messages: x (n), x(t-d) (n), u (m), then o.
    centre, radius : of all variables. A radius may be infinite where nothing depends on it, and
        is zero for u, in which the function is linear.
    n, m : numbers of states and of controls.
    first : states that move first, so that a product with them is uncertain in its other factor.
    by_norm : rows and columns of a part whose norm is bounded as a whole, such as a rotation; it
        depends on the states that move first alone.
    weights : of x in the nominal loop that decides which factor of a product is uncertain.
    """

    names: tuple[str, ...]
    centre: tuple[float, ...]
    radius: tuple[float, ...]
    n: int
    m: int
    first: tuple[int, ...] = ()
    by_norm: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    weights: tuple[float, ...] = ()


@dataclass(frozen=True)
class LinearEnclosure:
    """What `enclose` proved.

    Attributes
    ----------
    A, A1, B : (n, n), (n, n), (n, m).
    uncertain : E (n, s), H (r, 2 n) of x and x(t-d), and the blocks of F.
    disturbance : (n,) bound of f(o) - f0.
    order : the states, in the order in which they moved.
    needed : names of the variables whose bounds the proof uses.
    """

    A: Bounds
    A1: Bounds
    B: Bounds
    uncertain: UncertainMatrix
    disturbance: Bounds
    order: tuple[int, ...]
    needed: tuple[str, ...]


def enclose(function: Function, box: Box) -> LinearEnclosure:
    """Linearise a function over a box.

    Raises
    ------
    InputError : it depends on a variable without a bound; it is not defined or not differentiable
        over the box; the effect of a control is not constant; the control does not stabilise x.
    """
    n, columns = box.n, 2 * box.n + box.m
    needed = _needed(function, box)
    order = _order(function, box)
    lower, upper = _bounds(function, box, order, PIECES)
    centre, radius = centre_and_radius(lower[:, :columns], upper[:, :columns])
    wholes = _wholes(function, box, centre, radius)
    if (radius[:, 2 * n :] > 0).any():
        i, j = np.argwhere(radius[:, 2 * n :] > 0)[0]
        raise InputError(
            "the effect of a command depends on the state",
            where=f"{box.names[2 * n + j]} in {box.names[i]}'",
            expected="an actuator with a lag: what acts is then a state, and its effect is covered",
            hint="give the actuator its lag",
        )
    matrix = uncertain_matrix(centre[:, : 2 * n], radius[:, : 2 * n], wholes)
    still = [0.0] * columns + list(box.radius[columns:])
    low, high = change_of(function, box.centre, still)
    size = np.maximum(-low, high)
    return LinearEnclosure(
        matrix.centre[:, :n],
        matrix.centre[:, n:],
        centre[:, 2 * n :],
        matrix,
        np.where(size > 1e-12, size, 0.0),
        tuple(order),
        needed,
    )


def _bounds(
    function: Function, box: Box, order: Sequence[int], pieces: int
) -> tuple[Bounds, Bounds]:
    """Return the mean Jacobian for the states in this order; x(t-d) and u move after them."""
    columns = [*order, *range(box.n, 2 * box.n + box.m)]
    lower, upper = mean_jacobian(function, box.centre, box.radius, columns, pieces)
    wrong = np.argwhere(~(np.isfinite(lower) & np.isfinite(upper)))
    if wrong.size:
        i, j = wrong[0]
        raise InputError(
            "the equations are not differentiable over the envelope",
            where=f"{box.names[i]}', by {box.names[j]}",
            expected="an envelope in which every root, quotient and angle is defined",
            hint="a smaller bound, or a trim at speed: an angle of attack has no value at rest",
        )
    return lower, upper


def _needed(function: Function, box: Box) -> tuple[str, ...]:
    """Return the variables that the function is not linear in, each with a bound."""
    variables = [
        Dependence(frozenset([j])) if size else value
        for j, (value, size) in enumerate(zip(box.centre, box.radius, strict=True))
    ]
    used, bent = variables_of(function(variables, DEPENDENCE))
    moving = range(2 * box.n + box.m)
    wanted = [j for j in sorted(used) if j in bent or j not in moving]
    for j in wanted:
        if not math.isfinite(box.radius[j]):
            raise InputError(
                "a state has no bound, and the equations depend on it",
                where=f"envelope.{box.names[j]}",
                expected="a bound about the trim",
                hint=f'envelope = {{ "{box.names[j]}" = ... }}',
            )
    return tuple(box.names[j] for j in wanted)


def _order(function: Function, box: Box) -> list[int]:
    """Return the order of the states: the one that a nominal loop bears best.

    Begin with a product's uncertainty shared by its factors: the mean of an order and its reverse.
    """
    n = box.n
    first = list(box.first)
    rest = [j for j in range(n) if j not in first]
    starts = [[*first, *rest], [*first, *reversed(rest)]]
    tried = [_parts(function, box, order) for order in starts]
    order = starts[0]
    (A, B, q), (_, _, other) = tried
    gains = loop_gains(A, B, np.array(box.weights))
    if gains is None:
        raise InputError(
            "the commands do not stabilise the controlled states",
            where="control.states",
            expected="states that the actuators move, each of them by some command",
            got=", ".join(box.names[:n]),
        )
    # what no order changes, as the kinematics where angles move first, is no reason for one
    free = (np.abs(q - other) > 1e-9 * q.max(initial=0.0)).any(axis=1)[:, None]
    q = np.where(free, (q + other) / 2, 0.0)
    bounds = np.array([size if 0 < size < math.inf else 1e300 for size in box.radius[:n]])
    for _ in range(4):
        wanted = order_of_variables(q, gains, bounds)
        new = [*(j for j in wanted if j in first), *(j for j in wanted if j in rest)]
        if new == order:
            break
        order = new
        q = np.where(free, _parts(function, box, order)[2], 0.0)
    return order


def _parts(function: Function, box: Box, order: Sequence[int]) -> tuple[Bounds, Bounds, Bounds]:
    """Return A with what is delayed at once, B, and the radii of x, all roughly."""
    n = box.n
    lower, upper = _bounds(function, box, order, _ROUGH)
    centre, radius = centre_and_radius(lower, upper)
    return centre[:, :n] + centre[:, n : 2 * n], centre[:, 2 * n : 2 * n + box.m], radius[:, :n]


def _wholes(function: Function, box: Box, centre: Bounds, radius: Bounds) -> list[NormBlock]:
    """Return the block that is bounded by its norm, if that is less than by its entries.

    The states that move first are taken cell by cell; the norm in a cell is at most that of the
    middles plus that of the radii. `centre` becomes the value at the trim there.
    """
    inside: Any = radius[np.ix_(*box.by_norm)] > 0
    rows = [i for i, holds in zip(box.by_norm[0], inside.any(axis=1), strict=True) if holds]
    columns = [j for j, holds in zip(box.by_norm[1], inside.any(axis=0), strict=True) if holds]
    block = np.ix_(rows, columns)
    if len(rows) < 2 or len(columns) < 2:
        return []
    moving = [j for j in box.first if box.radius[j] > 0]
    each = round(_CELLS ** (1 / max(len(moving), 1)))
    grid = (np.arange(each) + 0.5) / each * 2 - 1
    places = np.array(list(itertools.product(grid, repeat=len(moving))))
    point = mean_jacobian(function, box.centre, [0.0] * len(box.names), columns, 1)
    middle = centre_and_radius(*point)[0][block]
    about: list[Any] = list(box.centre)
    size: list[Any] = list(box.radius)
    for k, j in enumerate(moving):
        about[j] = about[j] + places[:, k] * box.radius[j]
        size[j] = np.full(len(places), box.radius[j] / each * (1 + 1e-9))
    lower, upper = (bound[:, rows] for bound in jacobian(function, about, size, columns))
    off, spread = (upper + lower) / 2 - middle, (upper - lower) / 2
    norms = np.linalg.norm(off, 2, axis=(1, 2)) + np.linalg.norm(spread, 2, axis=(1, 2))
    largest = rounded_up(float(norms.max()))
    if not largest < np.linalg.norm(radius[block], 2):
        return []
    centre[block] = middle
    return [NormBlock(tuple(rows), tuple(columns), largest)]
