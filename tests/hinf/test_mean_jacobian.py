"""Equations over a box: what is enclosed contains what floats compute, and little more."""

from __future__ import annotations

import functools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf.problem import Box, change_of, enclose, jacobian, mean_jacobian


def drag_across(
    v: Any, w: Any, sway: float, heave: float, softening: float, root: Any = math.sqrt
) -> Any:
    """The drag across a hull, by its formula."""
    size = (sway * v * v + heave * w * w) / (root(v * v + w * w) + softening)
    return size * v, size * w


FLOATS = SimpleNamespace(
    coupled_drag=drag_across,
    **{n: getattr(math, n) for n in ("sin", "cos", "asin", "atan2", "sqrt", "exp")},
    min=min,
    max=max,
)
EXPRESSIONS = {
    "sin": lambda x, n: [n.sin(x[0] * x[1]), n.sin(3 * x[0])],
    "cos": lambda x, n: [n.cos(4 * x[0]) * x[1]],
    "asin": lambda x, n: [n.asin(x[0] / 2)],
    "atan2": lambda x, n: [n.atan2(x[0], 1.5 + x[1])],
    "sqrt": lambda x, n: [n.sqrt(1.5 + x[0] * x[0]) * x[1]],
    "exp": lambda x, n: [n.exp(-3 * (1 + x[0])) * x[1], 1 / (3 + x[0] * x[1])],
    "abs": lambda x, _: [abs(x[0]) * x[1], -2 * abs(x[0] + x[1]) * (x[0] + x[1])],
    "powers": lambda x, _: [x[0] ** 3 - x[1] ** 2, (x[0] - x[1]) * (x[0] + x[1])],
    "drag": lambda x, n: n.coupled_drag(x[0] - 0.5 * x[1], x[1], 2.0, 0.6, 1e-3),
    "coupled drag": lambda x, n: n.coupled_drag(x[0], x[1], 0.4, 3.0, 1e-13),
    "limits": lambda x, n: [n.max(-0.5, n.min(0.5, x[0])) * x[1], n.min(x[0], x[1])],
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_the_change_is_enclosed_for_both_orders(name: str) -> None:
    """f(x) - f(x0) lies in the enclosed mean Jacobian times x - x0, and in the enclosed change."""
    expression, rng = EXPRESSIONS[name], np.random.default_rng(3)
    centre, radius = np.array([0.1, -0.2]), np.array([0.6, 0.7])
    low, high = change_of(expression, centre, radius)
    for order in ([0, 1], [1, 0]):
        lower, upper = mean_jacobian(expression, centre, radius, order, 16)
        for _ in range(200):
            step = rng.uniform(-1, 1, 2) * radius
            before, after = (expression(list(p), FLOATS) for p in (centre, centre + step))
            change = np.array(after) - before
            ends = np.sort([lower * step, upper * step], axis=0).sum(axis=2)
            assert (ends[0] - 1e-12 <= change).all()
            assert (change <= ends[1] + 1e-12).all()
            assert ((low - 1e-12 <= change) & (change <= high + 1e-12)).all()


@pytest.mark.parametrize(
    "name", ["sin", "cos", "asin", "atan2", "sqrt", "exp", "powers", "coupled drag"]
)
def test_derivatives_are_those_of_complex_steps(name: str) -> None:
    """At a point the enclosure is the derivative, to rounding."""
    import cmath  # noqa: PLC0415

    point = [0.3, -0.4]
    names = ("sin", "cos", "asin", "sqrt", "exp")
    ns = SimpleNamespace(**{n: getattr(cmath, n) for n in names})
    ns.atan2 = lambda y, x: cmath.atan(y / x)
    ns.coupled_drag = functools.partial(drag_across, root=cmath.sqrt)
    lower, upper = mean_jacobian(EXPRESSIONS[name], point, [0.0, 0.0], [0, 1], 1)
    for j in range(2):
        moved: list[Any] = list(point)
        moved[j] += 1e-30j
        slope = [row.imag / 1e-30 for row in EXPRESSIONS[name](moved, ns)]
        assert lower[:, j] == pytest.approx(slope, rel=1e-11, abs=1e-13)
        assert upper[:, j] == pytest.approx(slope, rel=1e-11, abs=1e-13)


def test_slopes_of_drag_across_contain_those_of_its_formula() -> None:
    """At points, whatever the speed that softens it is to that of the flow."""
    import cmath  # noqa: PLC0415

    rng = np.random.default_rng(5)
    for _ in range(60):
        point, (sway, heave) = rng.uniform(-0.3, 0.3, 2), rng.uniform(0.1, 3.0, 2)
        coefficients = sway, heave, float(10 ** rng.uniform(-3, 0))
        lower, upper = mean_jacobian(
            lambda x, n, c=coefficients: n.coupled_drag(*x, *c), point, [0.0, 0.0], [0, 1], 1
        )
        for j in range(2):
            moved = [complex(x) for x in point]
            moved[j] += 1e-30j
            slopes = [row.imag / 1e-30 for row in drag_across(*moved, *coefficients, cmath.sqrt)]
            assert (lower[:, j] <= slopes).all()
            assert (slopes <= upper[:, j]).all()


def test_drag_costs_its_sector_and_a_product_its_later_factor() -> None:
    """-d v |v| lies in [-d v_bar, 0]; 3 u v is 3 u_bar in the column of v when v moves last."""

    def f(x: Any, _: Any) -> list[Any]:
        return [-2.0 * abs(x[0]) * x[0], 3.0 * x[0] * x[1] + x[0] * x[0]]

    def across(x: Any, n: Any) -> Any:
        return [-n.coupled_drag(x[0], 0.0, 2.0, 1.0, 1e-9)[0]]

    alike = mean_jacobian(across, [0.0, 0.0], [0.5, 0.2], [0, 1], 64)
    lower, upper = mean_jacobian(f, [0.0, 0.0], [0.5, 0.2], [0, 1], 64)
    assert [end[0, 0] for end in alike] == pytest.approx([lower[0, 0], 0.0], rel=0.02, abs=1e-8)
    assert -1.0 * (1 + 1 / 60) <= lower[0, 0] <= -1.0
    assert abs(upper[0, 0]) < 1e-12
    # a quadratic term is half of its slope exactly, and what cancels does
    assert (lower[1], upper[1]) == (pytest.approx([-0.5, -1.5]), pytest.approx([0.5, 1.5]))
    lower, upper = mean_jacobian(lambda x, _: [x[0] - x[0]], [0.0], [1.0], [0])
    assert max(upper[0, 0], -lower[0, 0]) < 1e-12


def test_cells_of_a_rotation() -> None:
    """In cells of an angle the derivative is the rotation there."""

    def f(x: Any, n: Any) -> list[Any]:
        c, s = n.cos(x[0]), n.sin(x[0])
        return [c * x[1] - s * x[2], s * x[1] + c * x[2]]

    places = np.linspace(-0.3, 0.3, 7)
    lower, upper = jacobian(f, [places, 0.0, 0.0], [1e-9, 0.1, 0.1], [1, 2])
    for k, psi in enumerate(places):
        turn = [[math.cos(psi), -math.sin(psi)], [math.sin(psi), math.cos(psi)]]
        assert lower[k] == pytest.approx(np.array(turn), abs=1e-8)
        assert upper[k] == pytest.approx(np.array(turn), abs=1e-8)


def box(**changed: Any) -> Box:
    """x1' = x2, x2' = -x2 |x2| + u + o^2 of the tests below."""
    usual: dict[str, Any] = {
        "names": ("x1", "x2", "x1(t-d)", "x2(t-d)", "u", "o"),
        "centre": (0.0,) * 6,
        "radius": (math.inf, 0.4, math.inf, 0.4, 0.0, 0.1),
        "n": 2,
        "m": 1,
        "weights": (1.0, 0.0),
    }
    return Box(**(usual | changed))


def drag(x: Any, _: Any) -> list[Any]:
    return [x[1], -abs(x[1]) * x[1] - 0.1 * x[3] + x[4] + x[5] * x[5]]


def test_a_linear_enclosure_names_what_it_uses() -> None:
    """Centre, blocks, the delayed part, the disturbance of other variables, and their bounds."""
    found = enclose(drag, box())
    assert pytest.approx(np.array([[0, 1], [0, -0.2]]), abs=0.004) == found.A
    assert pytest.approx(np.array([[0, 0], [0, -0.1]])) == found.A1
    assert pytest.approx(np.array([[0], [1]])) == found.B
    assert (found.uncertain.E @ found.uncertain.H)[1, 1] == pytest.approx(0.2, rel=0.02)
    assert found.disturbance == pytest.approx([0, 0.01], rel=1e-6)
    assert found.needed == ("x2", "o")


@pytest.mark.parametrize(
    ("function", "changed", "words"),
    [
        (drag, {"radius": (math.inf,) * 4 + (0.0, 0.1)}, r"envelope\.x2"),
        (lambda x, n: [x[1], n.sqrt(x[1]) + x[4]], {}, "not differentiable"),
        (lambda x, _: [x[1], (1 + x[1]) * x[4]], {}, "command depends on the state"),
        (lambda x, _: [x[1], x[1] + 0 * x[4]], {}, "do not stabilise"),
    ],
)
def test_what_has_no_linear_model_is_refused(function: Any, changed: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        enclose(function, box(**changed))
