"""Dotted paths and expressions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import pytest

from cosim.core import InputError
from cosim.scenario import put, split
from cosim.study import Metric
from cosim.study.measurement import measure, value_at
from cosim.study.schema import of_x

if TYPE_CHECKING:
    from cosim.master import Run


def test_paths_are_split_at_dots_outside_quotes() -> None:
    """Names with dots in quotes; parameters of a component need none."""
    assert split("links.uplink.delay") == ("links", "uplink", "delay")
    assert split("design.gain[0][12]") == ("design", "gain", 0, 12)
    hydro = ("components", "plant", "parameters", "hydro.X_udot")
    assert split('components.plant.parameters."hydro.X_udot"') == hydro
    assert split("components.plant.parameters.hydro.X_udot") == hydro
    assert split("components.c.parameters.K[1,2]")[-1] == "K[1,2]"


@pytest.mark.parametrize("path", ["", ".a", "a.", "a..b", "[0]", "a[b]", 'a."b', "a b]", "a.[0]"])
def test_invalid_paths_are_refused(path: str) -> None:
    """With the path."""
    with pytest.raises(InputError, match="not a path"):
        split(path)


def test_values_are_put_where_the_path_leads() -> None:
    """Tables on the way are made; places in lists must be there."""
    data = {"design": {"gain": [[1.0, 2.0]]}}
    put(data, split("design.gain[0][1]"), 9.0, "design.gain[0][1]")
    put(data, split("links.up.jitter.width"), 0.1, "links.up.jitter.width")
    assert data == {"design": {"gain": [[1.0, 9.0]]}, "links": {"up": {"jitter": {"width": 0.1}}}}
    with pytest.raises(InputError, match="no place 1"):
        put(data, split("design.gain[1][0]"), 1.0, "design.gain[1][0]")
    with pytest.raises(InputError, match="not inside a table"):
        put(data, split("design.gain.x"), 1.0, "design.gain.x")


def test_figures_are_found_under_names_with_dots() -> None:
    """`final` is one table by `component.variable`; a missing figure names the nearest."""
    data = {"final": {"plant.eta.x": 1.5, "plant.x[1]": 2.5}, "metrics": {"gain": None}}
    assert value_at(data, "final.plant.eta.x") == 1.5
    assert value_at(data, "final.plant.x[1]") == 2.5
    assert value_at(data, "metrics.gain") is None
    with pytest.raises(InputError, match=r"did you mean plant\.eta\.x"):
        value_at(data, "final.plant.eta.y")


def test_a_metric_is_computed_from_those_before() -> None:
    """A missing one, or a division by zero, gives none; a text is refused."""
    ratio = Metric(value="2 * error / 'a-b'", above=0.5)
    for a, b, found in ((1.0, 2.0, True), (1.0, 8.0, False), (None, 1.0, False), (1.0, 0.0, False)):
        assert measure(ratio, {}, cast("Run", None), {"error": a, "a-b": b}) is found
    plain = Metric(value="error ** 2 + e - e")
    assert measure(plain, {}, cast("Run", None), {"error": 3.0}) == 9.0
    with pytest.raises(InputError, match="no number"):
        measure(plain, {}, cast("Run", None), {"error": "diverged"})
    with pytest.raises(ValueError, match="either a path or a signal"):
        Metric(value="error", path="metrics.gain")


@pytest.mark.parametrize(
    ("text", "x", "value"),
    [
        ("x - 1.5 * 0.005", 0.02, 0.02 - 1.5 * 0.005),
        ("max(0, x) ** 2 / 4", 6.0, 9.0),
        ("-sin(pi * x) + sqrt(2)", 0.5, math.sqrt(2) - 1.0),
    ],
)
def test_expressions_are_arithmetic(text: str, x: float, value: float) -> None:
    """Compared with the same, written in Python."""
    assert of_x(text).number(x=x) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "", "y", "x +", "__import__('os')", "x.real", "[x]", "lambda: 1", "x if x else 1",
        "abs(x, key=1)", "open('f')", "'a'", "True", "x < 1", "(" * 500 + "x" + ")" * 500,
    ],
)  # fmt: skip
def test_other_text_is_refused_as_expression(text: str) -> None:
    """Whatever Python makes of it."""
    with pytest.raises(InputError, match="column"):
        of_x(text)


@pytest.mark.parametrize(("text", "x"), [("1 / x", 0.0), ("log(x)", -1.0), ("x", "a"),
                                         ("exp(x)", 1e4), ("x ** 0.5", -1.0)])  # fmt: skip
def test_an_expression_without_a_value_says_where(text: str, x: object) -> None:
    """The argument is in the message."""
    with pytest.raises(InputError, match="column 1") as refused:
        of_x(text).number(x=x)
    assert repr(x) in refused.value.text()
