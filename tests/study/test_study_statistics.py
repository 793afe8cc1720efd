"""What pages and pictures of studies draw, against closed forms, SciPy and the summary."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr
from study.studies_at_hand import study_folder

from cosim.study import read_table
from cosim.study.association import cells_of, groups_of, rank_correlations
from cosim.study.columns import Column, column_of, columns_of
from cosim.study.convergence import convergence_of
from cosim.study.distribution import distribution_of
from cosim.study.points import Points
from cosim.study.summary import mean_of, share


def test_every_run_is_in_one_bin() -> None:
    """Also of values that are equal, far apart, or beyond all arithmetic; and of none."""
    for values in (
        np.random.default_rng(1).normal(size=1000),
        np.full(7, 3.0),
        np.zeros(1),
        np.array([-1e308, 1e308]),
        np.array([1.0, np.nextafter(1.0, 2.0)]),
        np.zeros(0),
    ):
        found = distribution_of(Column("x", "number", values))
        assert found.counts.sum() + found.below + found.above == values.size
        assert np.isfinite(found.edges).all()
    far = distribution_of(Column("x", "number", np.array([*np.linspace(0, 1, 200), 1e9])))
    assert (far.below, far.above) == (0, 1)
    assert far.edges[-1] <= 1.0
    assert "1 above 1" in far.outside
    truths = distribution_of(column_of("t", [True, False, None, True]))
    assert (truths.names, truths.counts.tolist()) == (("yes", "no"), [2, 1])
    texts = distribution_of(column_of("s", [*"aab", *map(str, range(40))]))
    assert (texts.names[0], texts.counts[0], texts.others) == ("a", 2, 12)


def test_the_estimate_settles_as_the_summary_has_it() -> None:
    """A draw is a sampled point over the whole grid; the interval is that of the draws' means."""
    table, manifest = read_table(study_folder("mixed"))
    columns = columns_of(table, manifest)
    assert columns.draws is not None
    points = Points(columns.study)
    u = list(columns.study.vary).index(columns.varied_axis("u"))
    drawn = {(int(d), points[run][u]) for d, run in zip(columns.draws, columns.runs, strict=True)}
    assert len(drawn) == 8
    metric = columns.metrics["x"]
    kept = [metric.known & (columns.draws == d) for d in range(8)]
    means = [metric.values[mine].mean() for mine in kept if mine.any()]
    assert len(means) < 8  # where u kills each of its runs there is no value
    found = convergence_of(columns, metric)
    assert found is not None
    assert found.draws.tolist() == list(range(1, len(means) + 1))
    for n, mean, low, high in zip(found.draws, found.mean, found.low, found.high, strict=True):
        wanted = mean_of(means[:n], n)
        assert mean == pytest.approx(wanted.mean)
        if n > 1:
            assert (low, high) == pytest.approx((wanted.low, wanted.high))
    alone = replace(columns, draws=np.arange(48))
    settled = convergence_of(alone, columns.metrics["small"])
    assert settled is not None
    wanted_share = share(int(columns.metrics["small"].values.sum()), 48)
    assert settled.method == "Wilson"
    assert (settled.low[-1], settled.high[-1]) == pytest.approx(
        (wanted_share.low, wanted_share.high)
    )
    assert convergence_of(replace(columns, draws=None), metric) is None


def test_groups_cells_and_correlations() -> None:
    """Means of groups and cells are those of their runs; SciPy has the same rank correlations."""
    columns = columns_of(*read_table(study_folder("mixed")))
    x, settled = columns.metrics["x"], columns.metrics["settled"]
    x0, decay, u = (columns.axes[name] for name in ("x0", "decay", "u"))
    groups = groups_of(x, x0)
    assert groups.names == ("0", "1", "50")
    for k, value in enumerate((0.0, 1.0, 50.0)):
        wanted = mean_of(x.values[x0.values == value].tolist(), 16)
        ends = (groups.mean[k], groups.low[k], groups.high[k])
        assert ends == pytest.approx((wanted.mean, wanted.low, wanted.high))
    exact = Column("y", "number", x0.values**2)
    assert groups_of(exact, x0).explained == pytest.approx(1.0)
    assert groups_of(exact, decay).explained == pytest.approx(0.0, abs=0.03)
    cells = cells_of(settled, x0, decay)
    for (j, i), value in np.ndenumerate(cells.values):
        at = (x0.values == (0.0, 1.0, 50.0)[i]) & (decay.values == (0.5, 1.0)[j])
        known = settled.values[at & settled.known]
        assert value == pytest.approx(known.mean(), nan_ok=True) if known.size else np.isnan(value)
    both = settled.known
    part = Column("part", "number", np.where(both, x.values, np.nan))
    found = rank_correlations([x, part], [u, x0, columns.metrics["outcome"]])
    assert found[0, 0] == pytest.approx(spearmanr(x.values[x.known], u.values[x.known]).statistic)
    wanted_one = spearmanr(x.values[both], u.values[both]).statistic
    assert found[1, 0] == pytest.approx(wanted_one)
    assert np.isnan(found[:, 2]).all()


def test_an_axis_of_many_values_is_taken_in_parts() -> None:
    """With equally many in each, in order; missing values belong to none."""
    axis = Column("a", "number", np.array([*np.arange(100.0)[::-1], np.nan]))
    group, names, centres = axis.groups
    assert (group[-1], len(names), len(centres)) == (-1, 12, 12)
    assert set(np.bincount(group[:-1])) <= {8, 9}
    assert (np.diff(group[:-1]) <= 0).all()
    assert (np.diff(centres) > 0).all()
