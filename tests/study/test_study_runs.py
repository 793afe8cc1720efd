"""Studies flown in this process: their tables, what fails, what is resumed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from study.deadly import DEADLY, RESULTS, RUN_LOG, U, plan, truth
from study.pools import RunByRun
from study.run_logs import write_bare

from cosim.core import InputError, LossError
from cosim.study import execute_study, read_rows, read_table
from cosim.trace import Trace


def table(path: Path) -> dict[str, list[Any]]:
    """The columns of a study's table."""
    found: dict[str, list[Any]] = read_table(path)[0].to_pydict()
    return found


def test_every_run_agrees_with_the_closed_form(tmp_path: Path) -> None:
    """x at the end for ten values of u, by number of the run; nothing is missing."""
    values = [0.5 * i - 2.0 for i in range(10)]
    done = execute_study(plan(values), tmp_path)
    found = table(tmp_path)
    assert found["run"] == list(range(10))
    assert found["u"] == values
    assert found["x"] == pytest.approx([truth(u) for u in values], rel=1e-14)
    assert set(found["status"]) == {"finished"}
    assert (done.runs, done.executed, done.statuses) == (10, 10, {"finished": 10})


def test_a_line_of_the_run_log_counts_as_it_was_written_or_not_at_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A changed value, number or status, and a line of another study: these runs are done again."""
    values = [0.5 * i for i in range(6)]
    execute_study(plan(values), tmp_path / "one")
    execute_study(plan([9.0] * 6), tmp_path / "other")
    log = tmp_path / "one" / RUN_LOG
    lines = sorted(log.read_bytes().splitlines(), key=lines_run)
    foreign = sorted((tmp_path / "other" / RUN_LOG).read_bytes().splitlines(), key=lines_run)
    value = json.loads(lines[1])["row"][4]
    lines[1] = lines[1].replace(repr(value).encode(), repr(value + 1.0).encode())
    lines[2] = lines[2].replace(b"[2,", b"[3,")
    lines[4] = foreign[4]
    lines[5] = lines[5].replace(b'"finished"', b'"diverged"')
    log.write_bytes(b"\n".join([lines[0], lines[2], *lines[1:2], *lines[3:], b""]))
    with read_rows(tmp_path / "one") as rows:
        assert ([row.run for row in rows], rows.unread) == ([0, 3], 4)
    capsys.readouterr()
    pool = RunByRun()
    done = execute_study(plan(values), tmp_path / "one", pool)
    assert sorted(pool.runs) == [1, 2, 4, 5]
    assert "4 lines not as written" in capsys.readouterr().err
    assert (done.runs, done.statuses) == (6, {"finished": 6})
    assert table(tmp_path / "one")["x"] == pytest.approx([truth(u) for u in values], rel=1e-14)


def lines_run(line: bytes) -> int:
    """The number of the run that a line of a run log is about."""
    return int(json.loads(line)["row"][0])


def test_a_run_log_without_checksums_is_continued_and_gets_them(tmp_path: Path) -> None:
    """As earlier releases wrote it."""
    values = [0.5 * i for i in range(4)]
    execute_study(plan(values), tmp_path)
    write_bare(tmp_path, lambda rows: rows[:3])
    with read_rows(tmp_path) as rows:
        assert (len(rows), rows.unread) == (3, 0)
    assert execute_study(plan(values), tmp_path).executed == 1
    lines = (tmp_path / RUN_LOG).read_text().splitlines()
    assert len([json.loads(line)["check"] for line in lines]) == 4


def test_axes_change_the_places_they_name(tmp_path: Path) -> None:
    """Zipped rows, an expression in two places, and a fixed change: each run is the closed form."""
    axes = [
        {"kind": "grid", "name": "both", "paths": [U, "run.end"], "rows": [[2.0, 1.0], [3.0, 0.5]]},
        {"kind": "grid", "name": "step", "apply": {"run.step": "x / 10"}, "values": [1.0, 0.5]},
    ]
    execute_study(plan([], vary=axes, set={"run.seed": 5}), tmp_path)
    found = table(tmp_path)
    assert [json.loads(cell) for cell in found["both"]] == [[2.0, 1.0]] * 2 + [[3.0, 0.5]] * 2
    exact = [
        u + (1.0 - u) * (1.0 - h) ** round(end / h)
        for (u, end) in ((2.0, 1.0), (3.0, 0.5))
        for h in (0.1, 0.05)
    ]
    assert found["x"] == pytest.approx(exact, rel=1e-13)


def test_a_run_that_fails_is_recorded_and_stops_no_other(tmp_path: Path) -> None:
    """A step that fails, a value that is not allowed: each with its reason."""
    failing = plan([0.0, DEADLY, 1.0], "error")
    assert execute_study(failing, tmp_path / "a").statuses == {"finished": 2, "failed": 1}
    found = table(tmp_path / "a")
    assert found["status"] == ["finished", "failed", "finished"]
    assert "tiny" in found["reason"][1]
    axis = {"kind": "grid", "name": "step", "path": "run.step", "values": [0.1, -1.0, 50.0]}
    execute_study(plan([], vary=[axis]), tmp_path / "b")
    found = table(tmp_path / "b")
    assert found["status"] == ["finished", "refused", "refused"]
    assert found["x"][1:] == [None, None]
    assert "run.step" in found["reason"][1]
    assert "step 50 s" in found["reason"][2]


def test_a_run_whose_assertion_fails_is_not_finished(tmp_path: Path) -> None:
    """The table has another status and names the assertion; its trace is kept with the failed."""
    asserted = [{"name": "small", "always": "tiny.x < 2"}]
    failing = plan([0.5, 9.0], set={"assertions": asserted}, traces="failed")
    result = execute_study(failing, tmp_path)
    found = table(tmp_path)
    assert found["status"] == ["finished", "assertion_failed"]
    assert found["reason"] == [None, "failed: small"]
    assert list(result.traces) == [1]


def test_a_run_that_ends_the_process_ends_its_child_alone(tmp_path: Path) -> None:
    """In the first run, which is tried before the others, and in a later one."""
    result = execute_study(plan([DEADLY, 1.0, DEADLY + 1.0, 0.5]), tmp_path / "study")
    assert result.statuses == {"crashed": 2, "finished": 2}
    found = table(tmp_path / "study")
    assert found["status"] == ["crashed", "finished", "crashed", "finished"]
    for reason in (found["reason"][i] for i in (0, 2)):
        assert "component 'tiny'" in reason
        assert "SIGKILL" in reason
        assert "fmi2DoStep" in reason
    assert found["x"][1] == pytest.approx(truth(1.0), abs=1e-12)


def test_a_diverged_run_is_one_of_the_results(tmp_path: Path) -> None:
    """It is no failure, and has its figures up to where it got."""
    metrics = {"x": "final.tiny.x", "peak": {"signal": "tiny.x", "reduce": "max_abs"}}
    execute_study(plan([0.0, 50.0], set={"run.divergence": 20.0}, metrics=metrics), tmp_path)
    found = table(tmp_path)
    assert found["status"] == ["finished", "diverged"]
    first_beyond = next(truth(50.0, k) for k in range(99) if truth(50.0, k) > 20.0)
    assert found["peak"] == pytest.approx([1.0, first_beyond], rel=1e-13)


def test_a_study_that_is_interrupted_goes_on_and_repeats_nothing(tmp_path: Path) -> None:
    """Interrupted in the sixth run: six to go on with, and the table of one that was not."""
    values = [0.1 * i for i in range(10)]

    def interrupt(run: int) -> None:
        if run == 5:
            raise KeyboardInterrupt

    stopped, rest, nothing = RunByRun(interrupt), RunByRun(), RunByRun()
    with pytest.raises(KeyboardInterrupt):
        execute_study(plan(values), tmp_path / "a", stopped)
    assert stopped.runs == [1, 2, 3, 4, 5]  # the first run is the rehearsal's
    assert len(table(tmp_path / "a")["run"]) == 5
    done = execute_study(plan(values), tmp_path / "a", rest)
    assert rest.runs == [5, 6, 7, 8, 9]
    assert (done.runs, done.executed) == (10, 5)
    execute_study(plan(values), tmp_path / "b")
    same = [(tmp_path / name / RESULTS).read_bytes() for name in "ab"]
    assert same[0] == same[1]
    assert execute_study(plan(values), tmp_path / "a", nothing).executed == 0
    assert nothing.runs == []


@pytest.mark.parametrize("cut", [1, 7, 20])
def test_the_run_of_an_incomplete_line_is_repeated(tmp_path: Path, cut: int) -> None:
    """However much of it is there: that run and no other, and the same table."""
    values = [0.0, 1.0, 2.0]
    execute_study(plan(values), tmp_path)
    before = (tmp_path / RESULTS).read_bytes()
    run_log = tmp_path / RUN_LOG
    run_log.write_bytes(run_log.read_bytes()[:-cut])
    pool = RunByRun()
    execute_study(plan(values), tmp_path, pool)
    assert pool.runs == [2]
    assert (tmp_path / RESULTS).read_bytes() == before


def test_a_damaged_line_is_as_if_it_were_not_there(tmp_path: Path) -> None:
    """Also one with the number of a run that no study has, for which there is no memory."""
    values = [0.0, 1.0]
    execute_study(plan(values), tmp_path)
    lines = (tmp_path / RUN_LOG).read_bytes().splitlines(keepends=True)
    damaged = b'[1000000000000, "finished", null, 0.1, 1.0]\n[1, "fin\n'
    (tmp_path / RUN_LOG).write_bytes(lines[0] + damaged)
    pool = RunByRun()
    execute_study(plan(values), tmp_path, pool)
    assert pool.runs == [1]


def test_another_study_in_the_folder_is_not_mixed_with(tmp_path: Path) -> None:
    """Refused, with what differs; --fresh takes the folder."""
    execute_study(plan([0.0, 1.0]), tmp_path)
    other = plan([0.0, 2.0])
    with pytest.raises(InputError, match="results of another study") as refused:
        execute_study(other, tmp_path)
    assert "the same study" in refused.value.text()
    execute_study(other, tmp_path, fresh=True)
    assert table(tmp_path)["u"] == [0.0, 2.0]


def test_title_and_choice_of_traces_do_not_change_the_study(tmp_path: Path) -> None:
    """The two largest x get a trace afterwards; no run is flown for the table."""
    values = [0.0, 3.0, 1.0, 2.0]
    execute_study(plan(values), tmp_path)
    done = execute_study(plan(values, title="Two traces", traces="worst:2 by x"), tmp_path)
    assert done.executed == 0
    assert done.traces == {1: None, 3: None}
    names = sorted(p.name for p in (tmp_path / "traces").iterdir())
    assert names == ["run-1.mcap", "run-3.mcap"]
    trace = Trace(tmp_path / "traces" / "run-1.mcap")
    assert trace.read("/tiny/output")["x"][-1] == pytest.approx(truth(3.0), rel=1e-14)
    smallest = execute_study(plan(values, traces="worst:1 by -x"), tmp_path)
    assert list(smallest.traces) == [0]


def test_traces_of_all_and_of_failed_runs(tmp_path: Path) -> None:
    """A run that fails leaves a trace up to there."""
    values = [0.0, DEADLY]
    assert list(execute_study(plan(values, "error", traces="all"), tmp_path / "a").traces) == [0, 1]
    assert list(execute_study(plan(values, "error", traces="failed"), tmp_path / "b").traces) == [1]
    assert [p.name for p in (tmp_path / "b" / "traces").iterdir()] == ["run-1.mcap"]


def test_a_run_whose_trace_is_kept_is_executed_once(tmp_path: Path) -> None:
    """With `traces = "all"` each run writes its trace as it is flown, and the table is the same.

    The first one, too, which is tried before; none is repeated for its trace.
    """
    values, metrics = [0.0, 1.0, DEADLY], {"peak": {"signal": "tiny.x", "reduce": "max_abs"}}
    execute_study(plan(values, metrics=metrics), tmp_path / "none")
    pool, seen = RunByRun(), []

    def look(_what: str, _share: float) -> None:
        traces = (tmp_path / "all" / "traces").glob("run-*.mcap")
        seen.append(sorted((path.name, path.stat().st_ino) for path in traces))

    made = plan(values, metrics=metrics, traces="all")
    done = execute_study(made, tmp_path / "all", pool, progress=look)
    assert done.traces == dict.fromkeys(range(3))
    assert (pool.runs, len(pool.works)) == ([1, 2], 1)
    assert len(seen[-1]) == 3
    assert all(set(before) <= set(seen[-1]) for before in seen)  # none is written again
    assert read_table(tmp_path / "all")[0].equals(read_table(tmp_path / "none")[0])


def test_one_process_at_a_time(tmp_path: Path) -> None:
    """The second one is told, while the first goes on."""
    refused: list[InputError] = []

    def also(_what: str, _share: float) -> None:
        with pytest.raises(InputError, match="another process is running this study") as found:
            execute_study(plan([0.0, 1.0]), tmp_path)
        refused.append(found.value)

    done = execute_study(plan([0.0, 1.0]), tmp_path, progress=also)
    assert refused
    assert done.statuses == {"finished": 2}
    assert execute_study(plan([0.0, 1.0]), tmp_path).executed == 0


def test_a_table_with_missing_runs_is_not_written(tmp_path: Path) -> None:
    """Runs that nobody flew are an error, whoever lost them."""

    class Forgetful(RunByRun):
        def run_batches(self, *given: Any) -> Iterator[Any]:
            yield from (found for found in super().run_batches(*given) if found[0] != [2])

    with pytest.raises(LossError, match="runs are missing") as message:
        execute_study(plan([0.0, 1.0, 2.0, 3.0]), tmp_path, Forgetful())
    assert "without number 2" in message.value.text()
    assert not (tmp_path / RESULTS).exists()


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        ("metrics.gian", "did you mean gain"),
        ("final.tiny.z", "did you mean tiny.x"),
        ("metrics", "a metric must be a single value"),
        ({"signal": "tiny.y", "reduce": "rms"}, "there is no signal 'y'"),
        ({"signal": "tinny.x", "reduce": "rms"}, "did you mean tiny"),
    ],
)
def test_a_metric_that_no_run_has_is_refused_before_the_study_begins(
    tmp_path: Path, metric: Any, words: str
) -> None:
    """With the metric's own name; nothing is flown."""
    with pytest.raises(InputError) as refused:
        execute_study(plan([0.0, 1.0], metrics={"mine": metric}), tmp_path)
    import re  # noqa: PLC0415

    assert re.search(words, refused.value.text())
    assert "metrics.mine" in refused.value.text()
    assert table(tmp_path)["run"] == []


def test_a_study_of_which_no_run_succeeds_reports_why(tmp_path: Path) -> None:
    """The error of its first run, as if that were flown alone."""
    axis = {"kind": "grid", "name": "step", "path": "run.step", "values": [50.0, 60.0]}
    with pytest.raises(InputError, match="does not fit the run"):
        execute_study(plan([], vary=[axis]), tmp_path)


def test_the_table_contains_its_provenance(tmp_path: Path) -> None:
    """Study, scenario, hashes, versions and seeds are in the file itself."""
    made = plan([0.0, 1.0], seed=17)
    execute_study(made, tmp_path)
    _, about = read_table(tmp_path / RESULTS)
    assert about["digest"] == made.job.digest
    assert about["study"]["vary"][0]["path"] == U
    assert "x follows u" in about["scenario"]["text"]
    assert about["fmus"] == {"tiny.fmu": made.runner.fmu_cache.find("tiny.fmu").sha256}
    assert about["seeds"] == {"samples": 17, "run": 1}
    assert "auv-cosim" in about["versions"]


def test_a_changed_fmu_makes_another_study(tmp_path: Path) -> None:
    """Its hash is part of what the results depend on, and workers check it."""
    made = plan([0.0])
    runner = made.runner
    runner._hashes = {"tiny.fmu": "0" * 64}
    with pytest.raises(InputError, match="not the one that the study was started with"):
        execute_study(made, tmp_path)


def test_what_cannot_be_displayed_is_refused(tmp_path: Path) -> None:
    """No folder of a study, no table of one."""
    with pytest.raises(InputError, match="not the folder of a study"):
        read_table(tmp_path)
    (tmp_path / "x.parquet").write_text("no table")
    with pytest.raises(InputError, match="not the results of a study"):
        read_table(tmp_path / "x.parquet")


def test_a_table_in_parts_is_the_same_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seven runs in files of three: the rows, types and provenance of one file.

    A column has one type in all parts: u is whole in the first part, and a fraction in the last.
    The table of a study that is extended beyond one part becomes parts, and back.
    """
    values = [0, 1, 2, 3, 4, 5.5, 6]
    execute_study(plan(values, metrics={"x": "final.tiny.x"}), tmp_path / "one")
    monkeypatch.setattr("cosim.study.table.PART_RUNS", 3)
    execute_study(plan(values, metrics={"x": "final.tiny.x"}), tmp_path / "parts")
    parts = tmp_path / "parts" / RESULTS
    assert sorted(p.name for p in parts.iterdir()) == [f"part-000{i}.parquet" for i in range(3)]
    (one, about), (all_parts, also) = read_table(tmp_path / "one"), read_table(parts)
    assert about == also
    assert one.equals(all_parts, check_metadata=True)
    assert read_table(tmp_path / "parts")[0].equals(one)
    monkeypatch.setattr("cosim.study.table.PART_RUNS", 7)
    execute_study(plan(values, metrics={"x": "final.tiny.x"}), tmp_path / "parts")
    assert parts.read_bytes() == (tmp_path / "one" / RESULTS).read_bytes()
