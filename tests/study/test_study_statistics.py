"""What pages of studies draw, against closed forms, SciPy and the summary."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from study.deadly import study
from study.pages import chart_about, figures_of, numbers, page_of, words
from study.run_logs import table_of
from study.studies_at_hand import drawn, grid, study_folder

from cosim.study import Study, read_table

CLOSE = 1e-4
"""Of the span of its values, how exact the numbers of a chart are at least."""


@pytest.fixture(autouse=True)
def _light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without their library, which takes longest and is always the same."""
    monkeypatch.setattr("cosim.page.render.plotly_js", lambda: "")


def page_about(made: Study, columns: dict[str, Any], folder: Path) -> str:
    """The page about a study whose metrics have these values in its runs, None without."""
    rows = zip(*columns.values(), strict=True)
    table_of(made, [[k, "finished", None, 0.0, *row] for k, row in enumerate(rows)], folder)
    return page_of(folder, folder / "page.html")


def replicates(count: int, *metrics: str) -> Study:
    """A study of so many seeds."""
    axis = {"kind": "replicates", "count": count}
    return study([], vary=[axis], metrics=dict.fromkeys(metrics, "final.tiny.x"))


def students(values: Any) -> tuple[float, float, float]:
    """The mean, and its 95 % interval."""
    mean = float(np.mean(values))
    low, high = stats.t.interval(0.95, len(values) - 1, mean, stats.sem(values))
    return mean, float(low), float(high)


def near(values: Any) -> dict[str, float]:
    """How close a number of a chart with these values is."""
    return {"abs": CLOSE * float(np.ptp(values)) + 1e-9}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # in the deviation of the huge ones
def test_every_run_is_in_one_bin(tmp_path: Path) -> None:
    """Also of values that are equal, far apart, or beyond all arithmetic; and of none."""
    given: dict[str, Any] = {
        "normal": np.random.default_rng(1).normal(size=1000).tolist(),
        "equal": [3.0] * 7,
        "zero": [0.0],
        "huge": [-1e308, 1e308],
        "next": [1.0, float(np.nextafter(1.0, 2.0))],
        "none": [],
        "far": [*np.linspace(0, 1, 200).tolist(), 1e9],
        "truths": [True, False, None, True],
        "texts": [*"aab", *map(str, range(40))],
    }
    columns = {name: [*values, *[None] * (1000 - len(values))] for name, values in given.items()}
    html = page_about(replicates(1000, *given), columns, tmp_path)
    charts = figures_of(html)["charts"]
    bars = {
        name: charts[f"metric-{k}-distribution"]["data"][0]
        for k, name in enumerate(given)
        if f"metric-{k}-distribution" in charts
    }
    assert set(given) - set(bars) == {"none"}
    for name in ("normal", "equal", "zero", "huge", "next", "far"):
        assert sum(bars[name]["y"]) + (name == "far") == len(given[name])
        assert np.isfinite([*numbers(bars[name]["x"]), bars[name]["width"]]).all()
    assert numbers(bars["far"]["x"])[-1] + bars["far"]["width"] / 2 <= 1.0 + CLOSE
    text = words(html)
    assert re.findall(r"not drawn: (\d+) below \S+ and (\d+) above (\S+)", text) == [
        ("0", "1", "1")
    ]
    assert (bars["truths"]["x"], bars["truths"]["y"]) == (["yes", "no"], [2, 1])
    assert (bars["texts"]["x"][0], bars["texts"]["y"][0]) == ("a", 2)
    assert "not drawn: 12 runs with other values" in text


def test_the_estimate_settles_as_the_summary_has_it(tmp_path: Path) -> None:
    """The interval is Wilson's of the draws so far; over a grid, whose values are chosen, none."""
    charts = figures_of(page_of(study_folder("mixed"), tmp_path / "a.html"))["charts"]
    assert not [key for key in charts if "convergence" in key]
    truths = (np.arange(48) % 3 == 0).tolist()
    html = page_about(replicates(48, "small"), {"small": truths}, tmp_path / "b")
    low, high, _ = chart_about(html, "share of small", "draws")["data"]
    wanted = stats.binomtest(16, 48).proportion_ci(0.95, method="wilson")
    assert high["name"] == "95 %, Wilson"
    ends = numbers(low["y"])[-1], numbers(high["y"])[-1]
    assert ends == pytest.approx((wanted.low, wanted.high), abs=CLOSE)
    charts = figures_of(page_of(study_folder("few"), tmp_path / "c.html"))["charts"]
    assert not [key for key in charts if "convergence" in key]  # nothing is drawn at random


def test_groups_cells_and_correlations(tmp_path: Path) -> None:
    """Means of groups and cells are those of their runs; SciPy has the same rank correlations."""
    columns = read_table(study_folder("mixed"))[0].to_pandas()
    html = page_of(study_folder("mixed"), tmp_path / "mixed.html")
    groups = chart_about(html, "x", "x0")["data"][-1]
    assert groups["text"] == ["0", "1", "50"]
    for k, value in enumerate((0.0, 1.0, 50.0)):
        mean, low, high = students(columns.x[columns.x0 == value].dropna())
        assert numbers(groups["y"])[k] == pytest.approx(mean, **near(numbers(groups["y"])))
        assert groups["error_y"]["array"][k] == pytest.approx(high - mean)
        assert groups["error_y"]["arrayminus"][k] == pytest.approx(mean - low)
    charts = figures_of(html)["charts"]
    place = list(columns.columns[columns.columns.get_loc("reason") + 1 :]).index("settled")
    cells = charts[f"metric-{place}-map"]["data"][0]
    assert (cells["x"], cells["y"]) == (["0", "1", "50"], ["0.5", "1"])
    for (j, i), value in np.ndenumerate(numbers(cells["z"])):
        at = (columns.x0 == (0.0, 1.0, 50.0)[i]) & (columns.decay == (0.5, 1.0)[j])
        known = columns.settled[at].dropna()
        assert np.isnan(value) if known.empty else value == pytest.approx(known.mean(), rel=1e-4)
    found = charts["correlations"]["data"][0]
    assert "outcome" not in {*found["x"], *found["y"]}
    assert {"u", "x0", "decay", "x", "small"} <= set(found["x"])
    for (j, i), value in np.ndenumerate(numbers(found["z"])):
        both = columns[[found["x"][i]]].assign(of=columns[found["y"][j]]).dropna().astype(float)
        one, other = (both.iloc[:, k].to_numpy() for k in (0, 1))
        varies = np.ptp(one) > 0 and np.ptp(other) > 0
        wanted = stats.spearmanr(one, other).statistic if varies else np.nan
        assert value == pytest.approx(wanted, abs=CLOSE, nan_ok=True)


def test_a_group_explains_what_is_the_same_in_all_its_runs(tmp_path: Path) -> None:
    """All of a metric that follows from the axis, nothing where the axis does not matter."""
    seeds = {"kind": "replicates", "count": 8}
    axes = [grid("x0", [0.0, 1.0, 50.0]), grid("decay", [0.5, 1.0]), seeds]
    values = [x0**2 for x0, _, _ in product((0.0, 1.0, 50.0), range(2), range(8))]
    html = page_about(study([], vary=axes), {"x": values}, tmp_path)
    lies = r"Between the values of (\w+) lies (\d+) % of the variance"
    assert dict(re.findall(lies, words(html))) == {"x0": "100", "decay": "0"}


def test_an_axis_of_many_values_is_taken_in_parts(tmp_path: Path) -> None:
    """With equally many in each, in order; a run without a value of the metric counts in none."""
    made = study([], vary=[drawn("u", uniform=[0.0, 1.0])], samples=101)
    values: list[Any] = [*np.random.default_rng(2).normal(size=100).tolist(), None]
    html = page_about(made, {"x": values}, tmp_path)
    u = np.array(read_table(tmp_path)[0].column("u").to_pylist())
    groups = chart_about(html, "x", "u")["data"][-1]
    order, part = np.argsort(u), np.arange(101) * 12 // 101
    x = np.array([np.nan if v is None else v for v in values])[order]
    assert len(groups["text"]) == 12
    assert set(np.bincount(part)) <= {8, 9}
    for k, name in enumerate(groups["text"]):
        mine = u[order][part == k]
        assert name == f"{mine[0]:.4g} to {mine[-1]:.4g}"
        assert numbers(groups["x"])[k] == pytest.approx(np.median(mine), abs=CLOSE)
        mean = np.nanmean(x[part == k])
        assert numbers(groups["y"])[k] == pytest.approx(mean, **near(numbers(groups["y"])))
