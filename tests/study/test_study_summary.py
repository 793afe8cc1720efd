"""Intervals against published ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from study.deadly import study
from study.run_logs import table_of

from cosim.core import InputError
from cosim.study import Group, Numbers, Quantile, Share, summarise


def all_of(values: Sequence[Any], **options: Any) -> Group:
    """The summary of a study with these values of its metric x, all runs together."""
    n = len(values)
    table = pa.table({"run": range(n), "u": [0.0] * n, "status": ["finished"] * n, "x": values})
    manifest = {"study": study([0.0]).model_dump(mode="json"), "count": n}
    return summarise(table, manifest, [], **options).groups[0]


def share(count: int, of: int) -> Share:
    """The share of runs for which the metric is true."""
    return all_of([True] * count + [False] * (of - count)).shares["x"]


def mean_of(values: Sequence[float | None], **options: Any) -> Numbers:
    """The statistics of numbers."""
    return all_of(pa.array(values, pa.float64()), **options).numbers["x"]


def quantile_of(values: Sequence[float], share: float, confidence: float = 0.95) -> Quantile:
    """One quantile of numbers."""
    (found,) = mean_of(values, quantiles=(share,), confidence=confidence).quantiles
    return found


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_shares_have_wilsons_interval(count: int, of: int, low: float, high: float) -> None:
    """Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    found = share(count, of)
    assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)


def test_means_have_students_interval() -> None:
    """1 to 10: 5.5 +- t(0.975; 9) s / sqrt 10 = 2.262157 * 3.027650 / 3.162278."""
    found = mean_of([*(float(i) for i in range(1, 11)), None, float("inf")])
    half_width = 2.262157 * 3.027650 / 3.162278
    assert found.mean == 5.5
    assert (found.low, found.high) == pytest.approx((5.5 - half_width, 5.5 + half_width), rel=1e-6)
    assert (found.count, found.missing, found.median) == (10, 2, 5.5)
    alone = mean_of([1.0])
    assert (alone.low, alone.high) == (None, None)


def test_the_bootstrap_is_wider_where_the_tail_is() -> None:
    """One outlier to the right: the interval reaches further right; the same at each call."""
    values = [1.0] * 9 + [1.5] * 9 + [20.0]
    found = mean_of(values, bootstrap=True)
    assert found.low is not None
    assert found.high is not None
    assert found.mean is not None
    assert found.high - found.mean > found.mean - found.low
    assert mean_of(values, bootstrap=True) == found


def test_groups_are_those_of_the_axes_asked_for(tmp_path: Path) -> None:
    """Two values of u, two seeds each; means per group are of that group alone."""
    seeds = {"kind": "replicates", "name": "seed", "count": 2}
    grid = {"kind": "grid", "name": "u", "path": "run.divergence", "values": [1.0, 2.0]}
    rows = [[i, "finished" if i else "failed", None, 0.0, float(i)] for i in range(4)]
    table, manifest = table_of(study([], vary=[grid, seeds]), rows[::-1], tmp_path)
    assert table["run"].to_pylist() == [0, 1, 2, 3]
    found = summarise(table, manifest)
    assert found.by == ("u",)
    assert [g.where for g in found.groups] == [{"u": 1.0}, {"u": 2.0}]
    assert [g.numbers["x"].mean for g in found.groups] == [0.5, 2.5]
    assert found.groups[0].shares["status = failed"].share == 0.5
    together = summarise(table, manifest, [])
    assert together.groups[0].runs == 4
    with pytest.raises(InputError, match="there is no axis 'sed'"):
        summarise(table, manifest, ["sed"])
    for confidence in (0.0, 1.0, -0.5, 95.0, float("nan")):
        with pytest.raises(InputError, match="not a confidence"):
            summarise(table, manifest, confidence=confidence)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_intervals_of_quantiles_contain_the_true_one_as_often_as_they_say(share: float) -> None:
    """Of an exponential distribution; at least as often, and the exact count for a median of 10."""
    draw = np.random.default_rng(7)
    true = -np.log(1.0 - share)
    found = [quantile_of(draw.exponential(size=200).tolist(), share, 0.9) for _ in range(400)]
    count = sum(q.low is not None and q.high is not None and q.low <= true <= q.high for q in found)
    assert 0.88 * 400 <= count <= 0.97 * 400
    ten = quantile_of(range(1, 11), 0.5, 0.95)
    assert (ten.value, ten.low, ten.high) == (5.5, 2.0, 9.0)
    assert quantile_of(range(10), 0.99).high is None
