"""Dotted paths and expressions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from study.deadly import U, plan

from cosim.core import InputError
from cosim.scenario import load, put, split
from cosim.study import Metric, Study, execute_study, read_table, run_study


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


def test_figures_are_found_under_names_with_dots(native_fmus: Path, tmp_path: Path) -> None:
    """`final` is one table by `component.variable`; a missing figure names the nearest."""

    def found(name: str, metrics: dict[str, str]) -> dict[str, Any]:
        study = Study(
            title="t",
            scenario="heading-step",
            set={"run.end": 0.5},
            vary=[{"kind": "replicates", "count": 1}],
            metrics=metrics,
        )
        given = {"scenario": load("heading-step"), "fmus": native_fmus.parent}
        done = run_study(study, tmp_path / name, **given)
        row: dict[str, Any] = read_table(done.results)[0].to_pylist()[0]
        return row

    row = found("a", {"x": "final.plant.eta.x", "none": "metrics.worst_case"})
    assert isinstance(row["x"], float)
    assert row["none"] is None
    with pytest.raises(InputError, match=r"did you mean .*plant\.eta\.x"):
        found("b", {"x": "final.plant.eta.xx"})


def test_a_metric_is_computed_from_those_before(tmp_path: Path) -> None:
    """A missing one, or a division by zero, gives none; a text is refused."""
    x: dict[str, Any] = {"signal": "tiny.x", "reduce": "final"}
    metrics = {
        "a-b": x,
        "error": {**x, "to": -1.0},
        "none": {**x, "after": 99.0},
        "ratio": {"value": "2 * error / 'a-b'", "above": 3.5},
        "plain": {"value": "error ** 2 + e - e"},
        "of_none": {"value": "2 * none / 'a-b'", "above": 0.5},
        "no_number": {"value": "2 * none"},
    }
    axis = {"kind": "grid", "path": "components.tiny.parameters.x0", "values": [0.0, 1.0, 2.0]}
    still = {"components.tiny.parameters.decay": 0.0}
    execute_study(plan([], vary=[axis], set=still, metrics=metrics), tmp_path / "a")
    found = read_table(tmp_path / "a")[0].to_pydict()
    assert found["error"] == [1.0, 2.0, 3.0]
    assert found["ratio"] == [False, True, False]  # 2 / 0, 4 / 1, 6 / 2
    assert found["plain"] == pytest.approx([1.0, 4.0, 9.0], abs=1e-12)
    assert found["of_none"] == [False] * 3
    assert found["no_number"] == [None] * 3
    words = {"error": "status", "m": {"value": "error ** 2"}}
    with pytest.raises(InputError, match="no number"):
        execute_study(plan([0.0], metrics=words), tmp_path / "b")
    with pytest.raises(ValueError, match="either a path or a signal"):
        Metric(value="error", path="metrics.gain")


def applied(text: str, values: list[Any], out: Path) -> dict[str, list[Any]]:
    """The table of runs that end at what a text says of these values: one step from 0 to u."""
    axis = {"kind": "grid", "name": "given", "apply": {U: text}, "values": values}
    step = {"run.end": 1.0, "run.step": 1.0, "components.tiny.parameters.x0": 0.0}
    execute_study(plan([], vary=[axis], set=step), out)
    found: dict[str, list[Any]] = read_table(out)[0].to_pydict()
    return found


@pytest.mark.parametrize(
    ("text", "x", "value"),
    [
        ("x - 1.5 * 0.005", 0.02, 0.02 - 1.5 * 0.005),
        ("max(0, x) ** 2 / 4", 6.0, 9.0),
        ("-sin(pi * x) + sqrt(2)", 0.5, math.sqrt(2) - 1.0),
    ],
)
def test_expressions_are_arithmetic(text: str, x: float, value: float, tmp_path: Path) -> None:
    """Compared with the same, written in Python."""
    assert applied(text, [x], tmp_path)["x"] == [pytest.approx(value, rel=1e-15)]


@pytest.mark.parametrize(
    "text",
    [
        "", "y", "x +", "__import__('os')", "x.real", "[x]", "lambda: 1", "x if x else 1",
        "abs(x, key=1)", "open('f')", "'a'", "True", "x < 1", "(" * 500 + "x" + ")" * 500,
    ],
)  # fmt: skip
def test_other_text_is_refused_as_expression(text: str) -> None:
    """Whatever Python makes of it."""
    with pytest.raises(ValueError, match="column" if text else "at least 1 character"):
        plan([], vary=[{"kind": "grid", "apply": {U: text}, "values": [1.0]}])


@pytest.mark.parametrize(("text", "x"), [("1 / x", 0.0), ("log(x)", -1.0), ("x", "a"),
                                         ("exp(x)", 1e4), ("x ** 0.5", -1.0)])  # fmt: skip
def test_an_expression_without_a_value_says_where(text: str, x: object, tmp_path: Path) -> None:
    """The argument is in the reason of the runs, which are refused; another run is not."""
    found = applied(text, [x, 1.0, x], tmp_path)
    assert found["status"] == ["refused", "finished", "refused"]
    for run in (0, 2):
        assert "column 1" in found["reason"][run]
        assert repr(x) in found["reason"][run]
