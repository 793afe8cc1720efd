"""Which values every run has: grids, drawn points, replicates."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.core import InputError
from cosim.study import Points, Study


def points(*vary: dict[str, Any], **more: Any) -> Points:
    """Points of a study with these axes."""
    named = [{"path": f"run.p{i}", **axis} for i, axis in enumerate(vary)]
    return Points(Study(title="t", scenario="s", vary=named, metrics={"a": "status"}, **more))


def column(found: Points, axis: int) -> np.ndarray[Any, Any]:
    """The values of one axis in all runs."""
    return np.array([found[run][axis] for run in range(found.count)])


def test_a_grid_is_the_product_the_first_axis_slowest() -> None:
    """Two grids and replicates count like the digits of a number."""
    found = points(
        {"kind": "grid", "values": [10, 20]},
        {"kind": "grid", "linspace": [0.0, 1.0, 3]},
        {"kind": "replicates", "count": 2, "first": 5},
    )
    assert [found[i] for i in range(found.count)] == list(
        product([10, 20], [0.0, 0.5, 1.0], [5, 6])
    )


def test_spaced_values_are_short_decimals() -> None:
    """No 0.30000000000000004 among them; even ratios for logspace."""
    assert list(column(points({"kind": "grid", "linspace": [0.0, 0.7, 8]}), 0)) == [
        0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7,
    ]  # fmt: skip
    assert list(column(points({"kind": "grid", "logspace": [0.01, 10.0, 4]}), 0)) == [
        0.01, 0.1, 1.0, 10.0,
    ]  # fmt: skip


@pytest.mark.parametrize("kind", ["random", "sobol", "latin"])
@pytest.mark.parametrize(
    ("how", "truth"),
    [
        ({"uniform": [2.0, 5.0]}, stats.uniform(2, 3)),
        ({"loguniform": [0.01, 100.0]}, stats.loguniform(0.01, 100)),
        ({"normal": [3.0, 0.5]}, stats.norm(3, 0.5)),
        ({"lognormal": [3.0, 0.5]}, stats.lognorm(0.5, scale=3.0)),
        ({"triangular": [1.0, 2.0, 5.0]}, stats.triang(0.25, 1.0, 4.0)),
        ({"empirical": [5.0, 1.0, 2.0]}, stats.rv_histogram(([1, 1], [1, 2, 5]), density=False)),
    ],
)
def test_draws_have_their_distribution(kind: str, how: dict[str, Any], truth: Any) -> None:
    """Kolmogorov and Smirnov do not object; a Sobol sequence is evener than chance."""
    drawn = column(points({"kind": kind, **how}, samples=1024, seed=3), 0)
    distance = stats.kstest(drawn, truth.cdf)
    assert distance.pvalue > 0.01
    if kind != "random":
        assert distance.statistic < 0.004


def test_integers_and_choices_give_every_value_and_no_other() -> None:
    """Both ends of `integers` belong to it."""
    found = points(
        {"kind": "random", "integers": [-1, 2]},
        {"kind": "sobol", "choice": ["a", "b"]},
        samples=400,
    )
    assert set(column(found, 0)) == {-1, 0, 1, 2}
    assert {found[i][1] for i in range(400)} == {"a", "b"}
    assert isinstance(found[0][0], int)


def test_two_sobol_axes_fill_the_square_evenly() -> None:
    """Every cell of a 16 x 16 board holds one of 256 points: a (0, 8, 2)-net."""
    axis = {"kind": "sobol", "uniform": [0.0, 1.0]}
    found = points(axis, axis, samples=256, seed=9)
    cells = {(int(16 * x), int(16 * y)) for x, y in (found[i] for i in range(256))}
    assert len(cells) == 256


def test_the_same_draws_meet_every_cell_of_the_grid() -> None:
    """Two cells differ by what the grid moves and by nothing else."""
    found = points(
        {"kind": "grid", "values": [1, 2]}, {"kind": "random", "normal": [0.0, 1.0]}, samples=7
    )
    drawn = column(found, 1)
    assert list(drawn[:7]) == list(drawn[7:])
    assert len(set(drawn)) == 7


def test_another_seed_draws_others_and_the_same_seed_the_same() -> None:
    """Draws are a function of the seed and the axis."""
    axis = {"kind": "random", "uniform": [0.0, 1.0]}
    assert list(column(points(axis, samples=5, seed=1), 0)) == list(
        column(points(axis, samples=5, seed=1), 0)
    )
    assert column(points(axis, samples=5, seed=2), 0)[0] != column(points(axis, samples=5), 0)[0]


def test_random_axes_have_streams_of_their_own() -> None:
    """Two alike draw differently; what follows an axis changes nothing of it."""
    axis = {"kind": "random", "uniform": [0.0, 1.0]}
    both = points(axis, axis, samples=20, seed=4)
    assert not set(column(both, 0)) & set(column(both, 1))
    assert list(column(both, 0)) == list(column(points(axis, samples=20, seed=4), 0))


def test_the_least_number_drawn_has_a_normal_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """0 is one of 2^53 steps: as far out as the first of them, not infinitely far."""

    class Drawn:
        def random(self, _count: int) -> np.ndarray[Any, Any]:
            return np.array([0.0, 2.0**-53, 0.5])

    monkeypatch.setattr(np.random, "default_rng", lambda _seed: Drawn())
    drawn = column(points({"kind": "random", "normal": [1.0, 2.0]}, samples=3), 0)
    assert drawn[0] == drawn[1] == pytest.approx(1.0 + 2.0 * stats.norm.ppf(2.0**-53))
    assert drawn[2] == 1.0


def test_a_latin_hypercube_has_a_point_in_every_interval_of_every_axis() -> None:
    axis = {"kind": "latin", "uniform": [0.0, 1.0]}
    found = points(axis, axis, axis, samples=50, seed=2)
    for place in range(3):
        assert sorted(int(50 * x) for x in column(found, place)) == list(range(50))


def test_weights_are_the_shares_of_the_choices() -> None:
    axis = {"kind": "latin", "choice": ["a", "b", "c"], "weights": [1.0, 2.0, 5.0]}
    drawn = [points(axis, samples=800)[i][0] for i in (0, 1)]
    assert set(drawn) <= {"a", "b", "c"}
    found = points(axis, samples=800)
    assert [sum(found[i][0] == name for i in range(800)) for name in "abc"] == [100, 200, 500]


@pytest.mark.parametrize("kind", ["random", "sobol"])
def test_correlated_axes_keep_their_distributions(kind: str) -> None:
    """Spearman's correlation of a Gaussian copula is 6 / pi asin(r / 2); the third is alone."""
    found = points(
        {"kind": kind, "name": "a", "path": "run.p0", "uniform": [0.0, 1.0]},
        {"kind": kind, "name": "b", "path": "run.p1", "normal": [0.0, 2.0]},
        {"kind": kind, "name": "c", "path": "run.p2", "uniform": [0.0, 1.0]},
        samples=4096,
        correlations=[{"axes": ["b", "a"], "value": -0.8}],
    )
    a, b, c = (column(found, i) for i in range(3))
    expected = 6.0 / np.pi * np.arcsin(-0.4)
    assert stats.spearmanr(a, b).statistic == pytest.approx(expected, abs=0.02)
    assert abs(stats.spearmanr(a, c).statistic) < 0.05
    assert stats.kstest(b, stats.norm(0, 2).cdf).pvalue > 0.01
    assert list(c) == list(
        column(points(*([{"kind": kind, "uniform": [0.0, 1.0]}] * 3), samples=4096), 2)
    )


def test_correlations_that_cannot_be_together_are_refused() -> None:
    axes = [{"kind": "random", "name": n, "path": f"run.p{n}", "normal": [0, 1]} for n in "abc"]
    pairs = (("a", "b", 0.9), ("b", "c", 0.9), ("a", "c", -0.9))
    with pytest.raises(InputError, match="cannot be together"):
        points(
            *axes,
            samples=4,
            correlations=[{"axes": [x, y], "value": r} for x, y, r in pairs],
        )


@pytest.mark.parametrize("kind", ["random", "sobol"])
def test_more_samples_begin_with_fewer_under_their_new_numbers(kind: str) -> None:
    """Every run of the small study is the run of the large one with the number that is said."""
    axes: list[dict[str, Any]] = [
        {"kind": "grid", "name": "g", "path": "run.g", "values": [1, 2, 3]},
        {"kind": kind, "name": "a", "path": "run.a", "uniform": [0.0, 1.0]},
        {"kind": kind, "name": "b", "path": "run.b", "normal": [0.0, 1.0]},
        {"kind": "replicates", "count": 2},
    ]
    more = {"correlations": [{"axes": ["a", "b"], "value": 0.5}]}
    few, many = points(*axes, samples=16, **more), points(*axes, samples=64, **more)
    numbers = [few.extended(run, many) for run in range(few.count)]
    assert len(set(numbers)) == few.count == 96
    assert [few[run] for run in range(96)] == [many[number] for number in numbers]


def test_too_many_runs_are_refused() -> None:
    """The number is said."""
    axis = {"kind": "grid", "linspace": [0.0, 1.0, 10_000]}
    with pytest.raises(InputError, match="too many runs") as refused:
        points(axis, axis)
    assert "100000000" in refused.value.text()
