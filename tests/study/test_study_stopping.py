"""Studies that stop at a width: what their intervals cover; nothing but the runs decides."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study.deadly import U, plan

from cosim.core import InputError
from cosim.study import Study, execute_study, read_table, stopping_of
from cosim.study.folder import RESULTS, RUN_LOG
from cosim.study.stopping import looks, stopping

MOST = 4000
AXIS: dict[str, Any] = {"kind": "random", "name": "u", "path": U, "normal": [0.0, 1.0]}


def asked(width: float, **more: Any) -> Study:
    """A study that stops."""
    return Study(
        title="t",
        scenario="s",
        vary=[AXIS],
        metrics={"m": "status"},
        samples=MOST,
        stop={"metric": "m", "width": width, **more},
    )


def share_of_misses(study: Study, truth: float, draw: Any, repeats: int) -> float:
    """How often the interval at the end misses the truth."""
    missed = 0
    for repeat in range(repeats):
        values = draw(np.random.default_rng([repeat, 5])).tolist()
        for n in looks(study.stop.first if study.stop else 0, MOST):
            found = stopping(study, values[:n], MOST)
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
    study = asked(width, confidence=0.9)
    draw = lambda rng: rng.random(MOST) < share  # noqa: E731
    assert share_of_misses(study, share, draw, 300) <= 0.1


def test_the_interval_of_a_mean_covers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of normal values at most 10 % miss; with an error of 10 % at each look more than that."""
    study = asked(0.75, confidence=0.9, first=10)
    draw = lambda rng: rng.normal(3.0, 1.0, MOST)  # noqa: E731
    assert share_of_misses(study, 3.0, draw, 800) <= 0.1
    monkeypatch.setattr("cosim.study.stopping.look_error", lambda *_: 0.1)
    assert share_of_misses(study, 3.0, draw, 800) > 0.1


def test_a_share_of_nothing_is_given_up_at_the_last_look() -> None:
    """Too wide at the end: what was reached is said, and still holds."""
    found = stopping(asked(0.001), [True, False] * (MOST // 2), MOST)
    assert found is not None
    assert (found.reached, found.runs, found.looks[-1]) == (False, MOST, MOST)
    assert found.low < 0.5 < found.high
    assert stopping(asked(0.1), [True] * 49, MOST) is None
    gaps = stopping(asked(0.5), [True, None] * 40, MOST)
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
    assert found.runs in looks(20, 400)

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
