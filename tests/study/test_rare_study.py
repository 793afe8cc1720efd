"""Rare events through the flight master: on any pool, resumed, repeated; axes given others.

x at the end is linear in u and in x0, which are normal: its probability is known.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats
from study.deadly import RESULTS, RUN_LOG, STEP, STEPS, U, plan
from study.pools import RunByRun

from cosim.core import ComponentError, InputError
from cosim.study import (
    Plan,
    Points,
    RareEstimate,
    Study,
    execute_study,
    plain_sample,
    pool_for,
    rare_estimate,
    read_table,
    repeat_run,
)

LEFT = (1.0 - STEP) ** STEPS  # of x0 at the end
U_AXIS: dict[str, Any] = {"kind": "random", "name": "u", "path": U, "normal": [0.0, 1.0]}
X0_AXIS: dict[str, Any] = {
    "kind": "random",
    "name": "x0",
    "path": "components.tiny.parameters.x0",
    "normal": [1.0, 2.0],
}
R = 0.5
SIGMA = math.sqrt((1 - LEFT) ** 2 + (2 * LEFT) ** 2 + 2 * R * (1 - LEFT) * 2 * LEFT)


def event(probability: float, **more: Any) -> Any:
    """x at the end is above a bound, with this probability; the axes are correlated."""
    bound = LEFT + SIGMA * float(stats.norm.isf(probability))
    rare = {"metric": "x", "above": bound, **more.pop("rare", {})}
    return plan(
        [],
        **{
            "vary": [U_AXIS, X0_AXIS],
            "correlations": [{"axes": ["u", "x0"], "value": R}],
            "metrics": {"x": "final.tiny.x"},
            "samples": 100,
            "rare": rare,
            **more,
        },
    )


@pytest.mark.slow
def test_subset_simulation_through_the_master(tmp_path: Path) -> None:
    """Its interval contains the closed form; interrupted anywhere, the table has the same bytes."""
    made = event(1e-2, seed=4)
    done = execute_study(made, tmp_path)
    table, manifest = read_table(tmp_path)
    found = rare_estimate(table, manifest)
    assert found is not None
    assert found.probability is not None
    low, high = found.interval(0.95)
    assert low <= 1e-2 <= high
    assert high / low < 40
    levels = table.column("level").to_pylist()
    assert done.runs == done.count == len(levels)
    # two populations of fifty; nine moves of five chains of each, as far as each has to go
    assert (levels.count(1), levels.count(2)) == (100, 9 * 10)
    assert levels == sorted(levels)
    # then the exploration: two hundred points, and four moves of twenty in a step
    assert done.runs > 100 + 9 * 10 + 200
    x = table.column("x").to_pylist()
    u, x0 = (table.column(name).to_pylist() for name in ("u", "x0"))
    assert x == pytest.approx([a + (b - a) * LEFT for a, b in zip(u, x0, strict=True)], rel=1e-9)
    first, about = plain_sample(table, manifest)
    assert first.num_rows == about["count"] == 100

    bytes_before = (tmp_path / RESULTS).read_bytes()
    lines = (tmp_path / RUN_LOG).read_bytes().splitlines(keepends=True)
    (tmp_path / RESULTS).unlink()
    (tmp_path / RUN_LOG).write_bytes(b"".join(lines[:151]))
    assert rare_estimate(*read_table(tmp_path)) is None
    again = execute_study(event(1e-2, seed=4), tmp_path)
    assert again.executed == done.runs - 151
    assert (tmp_path / RESULTS).read_bytes() == bytes_before

    late = done.runs - 1
    outcome = repeat_run(event(1e-2, seed=4), late, tmp_path / "t.mcap", results=tmp_path)
    assert outcome.to_json()["final"]["tiny.x"] == x[late]
    with pytest.raises(InputError, match="no such run"):
        repeat_run(event(1e-2, seed=4), late, tmp_path / "t.mcap")
    with pytest.raises(InputError, match="results of another study"):
        repeat_run(event(1e-2, seed=5), late, tmp_path / "t.mcap", results=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["subset", "importance"])
def test_two_processes_give_the_table_of_one(tmp_path: Path, method: str) -> None:
    """Bit for bit, with traces of the worst runs of any level."""
    more = {"rare": {"method": method}, "traces": "worst:2 by x"}
    done = execute_study(event(5e-2, **more), tmp_path / "1")
    both = execute_study(event(5e-2, **more), tmp_path / "2", pool_for(2))
    assert (tmp_path / "1" / RESULTS).read_bytes() == (tmp_path / "2" / RESULTS).read_bytes()
    assert done.traces == both.traces
    assert set(done.traces.values()) == {None}


@pytest.mark.slow
def test_importance_sampling_is_extended(tmp_path: Path) -> None:
    """Fifty more points about the event: the pilot and the first points are kept."""
    given = {"rare": {"method": "importance", "pilot": 100}}
    few = execute_study(event(5e-2, samples=200, **given), tmp_path / "a")
    more = execute_study(event(5e-2, samples=250, **given), tmp_path / "a")
    assert (more.runs, more.executed) == (few.runs + 50, 50)
    execute_study(event(5e-2, samples=250, **given), tmp_path / "b")
    assert (tmp_path / "a" / RESULTS).read_bytes() == (tmp_path / "b" / RESULTS).read_bytes()
    found = rare_estimate(*read_table(tmp_path / "a"))
    assert found is not None
    assert found.effective is not None
    assert found.effective > 30
    low, high = found.interval(0.99)
    assert low <= 5e-2 <= high


def estimate_of(made: Plan, x: list[float | None], **parts: str) -> RareEstimate | None:
    """What a study of a rare event finds whose runs, in order, had these values of x."""
    manifest = {"study": made.job.study.model_dump(mode="json"), "parts": parts}
    return rare_estimate(pa.table({"run": range(len(x)), "x": x}), manifest)


def test_a_run_without_a_value_is_refused_or_counts_as_asked(tmp_path: Path) -> None:
    """Named, with what to do; or beyond, or within."""

    def found(**more: Any) -> RareEstimate | None:
        made = event(0.1, rare={"above": 1.0, **more})
        x = 2 * ([2.0] * 10 + [None] * 15 + [0.0] * 25)  # two populations
        return estimate_of(made, x, estimator="2")

    assert found() is None
    for missing, probability in (("beyond", 0.5), ("within", 0.2)):
        estimate = found(missing=missing)
        assert estimate is not None
        assert estimate.probability == pytest.approx(probability)

    axis = {**U_AXIS, "normal": [0.0, 400.0]}  # beyond 600 a run fails
    given: dict[str, Any] = {"vary": [axis], "samples": 100}
    rare = {"metric": "x", "above": 1e3}
    with pytest.raises(ComponentError, match=r"run \d+ has no value of x") as refused:
        execute_study(plan([], "error", rare=rare, **given), tmp_path / "x")
    table, manifest = read_table(tmp_path / "x")  # its runs can still be looked at
    first = table.column("status").to_pylist().index("failed")
    assert f"study repeat STUDY {first}" in refused.value.text()
    assert (table.num_rows, rare_estimate(table, manifest)) == (100, None)
    words = {"metrics": {"x": "status"}, "rare": rare}
    with pytest.raises(InputError, match="is a number"):
        execute_study(plan([], **given | {"vary": [U_AXIS]}, **words), tmp_path / "words")


def test_what_one_population_found_has_no_interval() -> None:
    """The runs of a folder from before two were compared: read, with its levels, and told so."""
    made = event(1e-2, rare={"above": 6.0})
    x = np.random.default_rng(1).normal(size=2000) + 0.01 * np.arange(2000)
    found = estimate_of(made, x.tolist())  # who wrote it named no estimator
    assert found is not None
    assert (found.probability, len(found.levels) > 1) == (None, True)
    assert "one population alone" in (found.reason or "")
    assert "estimator" in made.hashes
    assert "estimator" not in plan([], vary=[U_AXIS], samples=4).hashes


def test_a_bound_below_is_one_above_of_the_negative(tmp_path: Path) -> None:
    """The chains of the second level start at the lowest of the first, ten of a hundred runs."""

    def stop(run: int) -> None:
        if run == 110:
            raise KeyboardInterrupt

    made = plan([], vary=[U_AXIS], samples=100, rare={"metric": "x", "below": -4.0})
    with pytest.raises(KeyboardInterrupt):
        execute_study(made, tmp_path, RunByRun(stop))
    found = read_table(tmp_path)[0]
    assert found["level"].to_pylist() == [1] * 100 + [2] * 10
    u = found["u"].to_pylist()
    # of each population the five lowest of fifty start chains
    third = max(sorted(half)[4] for half in (u[:50], u[50:100]))
    assert max(u[100:]) < third + 3.0
    assert np.mean(u[100:]) < np.mean(u[:100]) - 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vary": [U_AXIS, {"kind": "replicates", "count": 3}]}, "drawn one from another"),
        ({"vary": [{**U_AXIS, "kind": "latin"}]}, "drawn one from another"),
        ({"vary": [{**U_AXIS, "kind": "saltelli"}]}, "drawn one from another"),
        ({"vary": [U_AXIS, {"kind": "grid", "path": "run.step", "values": [0.1]}]}, "drawn one"),
        ({"samples": 55}, "divided into chains"),
        ({"samples": 105}, "divided into chains"),
        ({"rare": {"metric": "y", "above": 1.0}}, "there is no metric 'y'"),
        ({"metrics": {"x": {"path": "final.tiny.x", "above": 1.0}}}, "is a number"),
    ],
)
def test_what_cannot_be_followed_is_refused(changes: dict[str, Any], words: str) -> None:
    given = {
        "vary": [U_AXIS],
        "samples": 100,
        "metrics": {"x": "final.tiny.x"},
        "rare": {"metric": "x", "above": 1.0},
        **changes,
    }
    with pytest.raises(InputError, match=words):
        plan([], **given)


def conditional(samples: int, kind: str = "random", **more: Any) -> Points:
    """A period that depends on a height."""
    axes = [
        {"kind": kind, "name": "Hs", "path": "run.a", "uniform": [1.0, 4.0]},
        {
            "kind": kind,
            "name": "Tp",
            "path": "run.b",
            "given": "Hs",
            "normal": ["3 * sqrt(x)", 0.3],
        },
    ]
    vary = [{**axes[0]}, {**axes[1], **more}]
    return Points(
        Study(title="t", scenario="s", vary=vary, metrics={"m": "status"}, samples=samples)
    )


@pytest.mark.parametrize("kind", ["random", "sobol", "latin"])
def test_an_axis_may_depend_on_an_earlier_one(kind: str) -> None:
    """What is left of the period is normal, and does not depend on the height."""
    points = conditional(2000, kind)
    height, period = np.array([points[run] for run in range(2000)]).T
    left = (period - 3.0 * np.sqrt(height)) / 0.3
    assert stats.kstest(left, stats.norm.cdf).pvalue > 0.01
    assert abs(stats.spearmanr(left, height).statistic) < 0.06
    assert [points[run] for run in range(9)] == [
        conditional(9, kind)[run] for run in range(9)
    ] or kind == "latin"


def test_parameters_that_are_none_at_a_point_are_named() -> None:
    with pytest.raises(InputError, match="no such parameters") as refused:
        conditional(10, normal=["x", "x - 2"])
    assert "Hs = " in refused.value.text()
    for wrong in ({"given": None}, {"normal": [1.0, 2.0]}, {"normal": ["y", 1.0]}):
        with pytest.raises(ValueError, match=r"need each other|no name 'y'"):
            conditional(10, **wrong)
    vary = [{**U_AXIS, "given": "x0", "normal": ["x", 1.0]}, X0_AXIS]
    with pytest.raises(InputError, match="no earlier sampled axis 'x0'"):
        plan([], vary=vary, samples=4)
