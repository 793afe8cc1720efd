"""Studies that stop at a width: what their intervals cover; nothing but the runs decides."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy.special import stdtrit
from study.deadly import RESULTS, RUN_LOG, U, plan

from cosim.core import InputError
from cosim.study import Stopping, Study, execute_study, read_table, stopping_of

MOST = 4000
AXIS: dict[str, Any] = {"kind": "random", "name": "u", "path": U, "normal": [0.0, 1.0]}


def asked(width: float, **more: Any) -> dict[str, Any]:
    """What the table of a study says that stops at a width."""
    study = Study(
        title="t",
        scenario="s",
        vary=[{"kind": "replicates", "count": MOST}],
        metrics={"m": "status"},
        stop={"metric": "m", "width": width, **more},
    )
    return {"study": study.model_dump(mode="json")}


def reached(manifest: dict[str, Any], values: list[Any]) -> Stopping | None:
    """What a study has reached whose first runs had these values of its metric."""
    return stopping_of(pa.table({"run": range(len(values)), "m": values}), manifest)


def looks(first: int) -> tuple[int, ...]:
    """Numbers of runs at which it is looked: each 1.3 times the one before, up to the most."""
    n = [first]
    while n[-1] < MOST:
        n.append(min(math.ceil(1.3 * n[-1]), MOST))
    return tuple(n)


def share_of_misses(manifest: dict[str, Any], truth: float, draw: Any, repeats: int) -> float:
    """How often the interval at the end misses the truth."""
    missed = 0
    for repeat in range(repeats):
        values = draw(np.random.default_rng([repeat, 5])).tolist()
        for n in looks(manifest["study"]["stop"]["first"]):
            found = reached(manifest, values[:n])
            assert found is not None
            if found.reached:
                break
        missed += not found.low <= truth <= found.high
    return missed / repeats


@pytest.mark.parametrize(("share", "width"), [(0.5, 0.2), (0.1, 0.1), (0.01, 0.03)])
def test_the_interval_of_a_share_covers_it_however_often_it_was_looked(
    share: float, width: float
) -> None:
    """At most 10 % of 300 studies miss."""
    manifest = asked(width, confidence=0.9)
    draw = lambda rng: rng.random(MOST) < share  # noqa: E731
    assert share_of_misses(manifest, share, draw, 300) <= 0.1


@pytest.mark.slow
def test_the_interval_of_a_mean_covers_it() -> None:
    """Of normal values at most 10 % miss; with an error of 10 % at each look more than that."""
    manifest = asked(0.75, confidence=0.9, first=10)
    draw = lambda rng: rng.normal(3.0, 1.0, MOST)  # noqa: E731
    assert share_of_misses(manifest, 3.0, draw, 800) <= 0.1
    missed = 0
    for repeat in range(800):
        values = draw(np.random.default_rng([repeat, 5]))
        for n in looks(10):
            half = stdtrit(n - 1, 0.95) * values[:n].std(ddof=1) / math.sqrt(n)
            if 2.0 * half <= 0.75:
                break
        missed += abs(values[:n].mean() - 3.0) > half
    assert missed / 800 > 0.1


def test_a_share_of_nothing_is_given_up_at_the_last_look() -> None:
    """Too wide at the end: what was reached is said, and still holds."""
    found = reached(asked(0.001), [True, False] * (MOST // 2))
    assert found is not None
    assert (found.reached, found.runs, found.looks) == (False, MOST, looks(50))
    assert found.low < 0.5 < found.high
    assert reached(asked(0.1), [True] * 49) is None
    gaps = reached(asked(0.5), [True, None] * 40)
    assert gaps is not None
    assert (gaps.missing, gaps.runs, gaps.value) == (32, 65, 1.0)


def stopped(width: float, samples: int = 400, **more: Any) -> Any:
    """A study of x at the end, which is linear in u."""
    metrics = {"x": "final.tiny.x"}
    stop = {"metric": "x", "width": width, "first": 20}
    return plan([], vary=[AXIS], samples=samples, metrics=metrics, stop=stop, **more)


@pytest.mark.slow
def test_the_table_is_the_same_whatever_was_there_before(tmp_path: Path) -> None:
    """Resumed in the middle of a look, extended, or with a width that was smaller before."""
    done = execute_study(stopped(0.6), tmp_path / "a")
    table = (tmp_path / "a" / RESULTS).read_bytes()
    found = stopping_of(*read_table(tmp_path / "a"))
    assert found is not None
    assert found.reached
    assert done.runs == done.count == found.runs < 400
    assert found.looks == tuple(n for n in looks(20) if n <= found.runs)
    assert found.runs == found.looks[-1]

    lines = (tmp_path / "a" / RUN_LOG).read_bytes().splitlines(keepends=True)
    (tmp_path / "a" / RESULTS).unlink()
    (tmp_path / "a" / RUN_LOG).write_bytes(b"".join(lines[:23]))
    again = execute_study(stopped(0.6), tmp_path / "a")
    assert again.executed == done.runs - 23
    assert (tmp_path / "a" / RESULTS).read_bytes() == table

    few = execute_study(stopped(0.6, samples=30), tmp_path / "b")
    assert few.runs == 30
    execute_study(stopped(0.6), tmp_path / "b")
    assert (tmp_path / "b" / RESULTS).read_bytes() == table

    more = execute_study(stopped(0.5), tmp_path / "c")
    assert more.runs > done.runs
    fewer = execute_study(stopped(0.6), tmp_path / "c")
    assert (fewer.runs, fewer.executed) == (done.runs, 0)
    assert (tmp_path / "c" / RESULTS).read_bytes() == table


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vary": [AXIS, {"kind": "replicates", "count": 3}]}, "independent draws"),
        ({"vary": [{**AXIS, "kind": "sobol"}]}, "independent draws"),
        ({"vary": [{"kind": "grid", "path": U, "values": [1.0]}], "samples": 1}, "independent"),
        ({"stop": {"metric": "y", "width": 1.0}}, "there is no metric 'y'"),
        ({"rare": {"metric": "x", "above": 1.0}}, "stop or rare"),
    ],
)
def test_what_cannot_stop_is_refused(changes: dict[str, Any], words: str) -> None:
    given = {"vary": [AXIS], "samples": 100, "stop": {"metric": "x", "width": 1.0}, **changes}
    with pytest.raises(InputError, match=words):
        plan([], metrics={"x": "final.tiny.x"}, **given)


def test_a_text_has_no_mean(tmp_path: Path) -> None:
    """Said at the first look, with what to do."""
    stop = {"metric": "m", "width": 1.0, "first": 10}
    made = plan([], vary=[AXIS], samples=20, metrics={"m": "status"}, stop=stop)
    with pytest.raises(InputError, match="neither share nor mean"):
        execute_study(made, tmp_path)


def test_a_part_of_a_study_that_decides_its_runs_is_refused() -> None:
    with pytest.raises(InputError, match="follow from the results"):
        stopped(0.6).part("0:10")
