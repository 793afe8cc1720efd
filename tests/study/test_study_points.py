"""Which values every run has: grids, drawn points, replicates."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cosim.core.errors import InputError
from cosim.study.points import Points, _distributed
from cosim.study.schema import SampledAxis, Study


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


@pytest.mark.parametrize("kind", ["random", "sobol"])
@pytest.mark.parametrize(
    ("how", "truth"),
    [
        ({"uniform": [2.0, 5.0]}, stats.uniform(2, 3)),
        ({"loguniform": [0.01, 100.0]}, stats.loguniform(0.01, 100)),
        ({"normal": [3.0, 0.5]}, stats.norm(3, 0.5)),
    ],
)
def test_draws_have_their_distribution(kind: str, how: dict[str, Any], truth: Any) -> None:
    """Kolmogorov and Smirnov do not object; a Sobol sequence is evener than chance."""
    drawn = column(points({"kind": kind, **how}, samples=1024, seed=3), 0)
    distance = stats.kstest(drawn, truth.cdf)
    assert distance.pvalue > 0.01
    if kind == "sobol":
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


def test_the_least_number_drawn_has_a_normal_value() -> None:
    """0 is one of 2^53 steps: as far out as the first of them, not infinitely far."""
    axis = SampledAxis(kind="random", path="run.p0", normal=[1.0, 2.0])
    drawn = _distributed(axis, np.array([0.0, 2.0**-53, 0.5]))
    assert drawn[0] == drawn[1] == pytest.approx(1.0 + 2.0 * stats.norm.ppf(2.0**-53))
    assert drawn[2] == 1.0


def test_too_many_runs_are_refused() -> None:
    """The number is said."""
    axis = {"kind": "grid", "linspace": [0.0, 1.0, 10_000]}
    with pytest.raises(InputError, match="too many runs") as refused:
        points(axis, axis)
    assert "100000000" in refused.value.text()
