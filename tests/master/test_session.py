"""Sessions: step, read, set, override, save and restore, bit for bit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from coupled import rewritten
from scalar import end, ns, scalar_fmu, scalars

from cosim.core import ComponentError, InputError
from cosim.master import (
    DelaySource,
    EngineName,
    Pace,
    Run,
    Session,
    Snapshot,
    System,
    TraceRecorder,
    simulate,
)
from cosim.network import DelayProfile, DelaySignal, Jitter, PacketLink, TransportLink
from cosim.trace import TraceWriter

PAIR = {"a": {"a": -1.0, "b": 1.5, "x0": 1.0}, "b": {"a": -0.5, "b": -2.0, "x0": -0.5}}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


@pytest.fixture(params=["python", "kernel"])
def engine(request: pytest.FixtureRequest) -> EngineName:
    name: EngineName = request.param
    return name


def linked(fmu: Path, **more: Any) -> System:
    """Two scalars over a packet link that loses messages, and a transport link."""
    links = [
        PacketLink(
            "p", ns(0.05), 0, ns(0.033), jitter=Jitter("uniform", width_ns=ns(0.1)), loss=0.3
        ),
        TransportLink("t", ns(0.07)),
    ]
    pairs = (("a.x", "b.u", "p"), ("b.x", "a.u", "t"))
    return scalars(fmu, PAIR, pairs, step=0.1, stop=5.0, links=links, **more)


def rows(run: Run) -> list[bytes]:
    return [run.signal(c, v).tobytes() for c in ("a", "b") for v in ("x", "y", "u")]


def test_single_steps_give_the_same_run(fmu: Path, engine: EngineName) -> None:
    whole = simulate(linked(fmu), engine=engine)
    with Session(linked(fmu), engine=engine) as session:
        session.step()
        assert session.rows == 1
        session.step(7)
        assert session.rows == 8
        session.run_until(2.0)
        assert session.time_s == 2.0
        assert not session.ended
        session.run_until()
        assert session.ended
        assert rows(session.result()) == rows(whole)
        assert session.result().status == "finished"


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_restore_and_continue_gives_the_same_run(
    fmu: Path, engine: EngineName, algorithm: str
) -> None:
    with Session(linked(fmu, algorithm=algorithm), engine=engine) as session:
        session.run_until(2.0)
        before = session.snapshot()
        session.run_until()
        first = rows(session.result())
        session.restore(before)
        assert session.time_s == 2.0
        assert not session.ended
        session.bias("b", "u", 0.5)  # another future
        session.run_until()
        assert rows(session.result()) != first
        session.restore(before)
        session.run_until()
        assert rows(session.result()) == first


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_another_session_continues_from_a_file(
    fmu: Path, engine: EngineName, algorithm: str, tmp_path: Path
) -> None:
    whole = simulate(linked(fmu, algorithm=algorithm), engine=engine)
    path = tmp_path / "at-2-s.npz"
    with Session(linked(fmu, algorithm=algorithm), engine=engine) as session:
        session.run_until(2.0)
        session.snapshot(portable=True).save(path)
    with Session(linked(fmu, algorithm=algorithm), engine=engine) as session:
        session.restore(Snapshot.load(path))
        session.run_until()
        assert rows(session.result()) == rows(whole)


def test_snapshot_of_another_system_is_refused(fmu: Path, tmp_path: Path) -> None:
    with Session(linked(fmu)) as session:
        session.step(3)
        kept = session.snapshot()
        with pytest.raises(InputError, match="bound to its session"):
            kept.save(tmp_path / "x.npz")
    other = scalars(fmu, PAIR, (("a.x", "b.u"),), step=0.1, stop=5.0)
    with Session(other) as session, pytest.raises(InputError, match="another system"):
        session.restore(kept)
    (tmp_path / "no.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="not a snapshot"):
        Snapshot.load(tmp_path / "no.npz")


def test_snapshot_of_another_algorithm_is_refused(fmu: Path) -> None:
    """Jacobi into Gauss-Seidel and back, and another order: the runs would differ."""
    ways: tuple[dict[str, Any], ...] = (
        {"algorithm": "jacobi"},
        {"algorithm": "gauss-seidel", "order": ("a", "b")},
        {"algorithm": "gauss-seidel", "order": ("b", "a")},
    )
    pairs = (("a.x", "b.u"), ("b.x", "a.u"))
    for taken in ways:
        for given in ({}, {"links": [TransportLink("t", ns(0.07))]}):
            named = tuple((*pair, "t") for pair in pairs) if given else pairs
            with Session(
                scalars(fmu, PAIR, named, step=0.1, stop=5.0, **given, **taken)
            ) as session:
                session.step(3)
                kept = session.snapshot(portable=True)
            for tried in ways:
                system = scalars(fmu, PAIR, named, step=0.1, stop=5.0, **given, **tried)
                with Session(system) as session:
                    if tried == taken:
                        session.restore(kept)
                        assert session.rows == 3
                        continue
                    with pytest.raises(InputError, match="another system"):
                        session.restore(kept)
                    assert session.rows == 0


def test_snapshot_of_another_recorded_delay_or_own_step_is_refused(fmu: Path) -> None:
    """Recordings with the same repr, and own steps that add no points, are told apart."""
    times = [0.005 * k for k in range(1200)]  # of more than 1000, repr shows the ends

    def system(delays: list[float], every: float = 0.2) -> System:
        link = TransportLink("t", delay=DelayProfile.from_seconds(times, delays, "linear"))
        given: dict[str, Any] = {"step": 0.1, "stop": 5.0, "links": [link]}
        return scalars(fmu, PAIR, (("a.x", "b.u", "t"),), every={"a": every}, **given)

    plain = [0.3] * 1200
    other = [*plain[:600], 0.2, *plain[601:]]
    assert repr(system(plain).links["t"]) == repr(system(other).links["t"])
    with Session(system(plain)) as session:
        session.step(4)
        kept = session.snapshot(portable=True)
    for tried in (system(other), system(plain, 0.4)):
        with Session(tried) as session, pytest.raises(InputError, match="another system"):
            session.restore(kept)
    with Session(system(plain)) as session:
        session.restore(kept)
        assert session.rows == 4


def test_snapshot_of_another_fmu_is_refused(fmu: Path, tmp_path: Path) -> None:
    """Another file with the same declarations."""
    other = rewritten(fmu, tmp_path / "other.fmu", ('modelName="scalar"', 'modelName="other"'))
    with Session(linked(fmu)) as session:
        session.step(3)
        kept = session.snapshot(portable=True)
    with Session(linked(other)) as session, pytest.raises(InputError, match="another system"):
        session.restore(kept)


@pytest.mark.parametrize("status", ["diverged", "failed"])
def test_run_that_cannot_go_on_is_not_saved(fmu: Path, status: str) -> None:
    """A failed or diverged run has no state to save; a finished one has."""
    growing = PAIR | {"a": {"a": 5.0, "x0": -1.0}}
    signal = PacketLink("p", ns(0.1), delay=DelaySignal(0.01, ns(0.02)))
    more: dict[str, Any] = {}
    if status == "failed":  # a negative delay, once x < -2
        more = {"links": [signal], "delays": {"p": DelaySource((end("a.x"),))}}
    pairs = (("a.x", "b.u", "p" if more else ""),)
    with Session(scalars(fmu, growing, pairs, step=0.1, stop=9.0, **more)) as session:
        session.go_on()
        assert session.status == session.result().status == status
        with pytest.raises((InputError, ComponentError), match=r"the run cannot go on|delay"):
            session.snapshot()
    with Session(scalars(fmu, PAIR, (("a.x", "b.u"),), step=0.1, stop=1.0)) as session:
        session.run_until()
        session.restore(session.snapshot())
        assert session.time_s == 1.0


def test_slave_without_states_is_named(tmp_path: Path) -> None:
    fmu = scalar_fmu(tmp_path, states=False)
    with Session(linked(fmu)) as session, pytest.raises(InputError, match="cannot save"):
        session.snapshot()


def test_restore_with_a_trace_is_refused(fmu: Path, tmp_path: Path) -> None:
    system = linked(fmu)
    with (
        TraceWriter(tmp_path / "t.mcap", run={}) as writer,
        Session(system, [TraceRecorder(writer, system)]) as session,
    ):
        before = session.snapshot()
        session.restore(before)  # nothing recorded yet
        session.run_until(1.0)
        with pytest.raises(InputError, match="cannot be taken back"):
            session.restore(before)


def test_values_are_those_at_the_time_of_the_session(fmu: Path, engine: EngineName) -> None:
    system = scalars(fmu, PAIR, (("a.x", "b.u"),), step=0.1, stop=1.0)
    with Session(system, engine=engine) as session:
        assert session.read("a", "x") == session.value("a", "x") == 1.0
        assert session.value("b", "u") == 1.0
        session.step()
        state = session.read("a", "x")
        assert session.value("a", "x") == state
        assert session.value("b", "u") == state
        assert state == pytest.approx(math.exp(-0.1), rel=1e-14)
        session.set("a", "u", 2.0)  # nothing is connected to it
        session.set("a", "a", -2.0)  # tunable
        session.step()
        expected = math.exp(-0.2) * state - math.expm1(-0.2) / 2.0 * 1.5 * 2.0
        assert session.read("a", "x") == pytest.approx(expected, rel=1e-14)
        with pytest.raises(InputError, match="this input is connected"):
            session.set("b", "u", 1.0)
        with pytest.raises(InputError, match="there is no variable 'aa'") as caught:
            session.set("a", "aa", 1.0)
        assert "cosim fmu info" in str(caught.value.hint)
        with pytest.raises(InputError, match="no component 'c'"):
            session.read("c", "x")


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_reading_values_changes_no_run(fmu: Path, engine: EngineName, algorithm: str) -> None:
    """Reading exchanges values at the present point; overrides and biases apply there once."""
    seen, runs = [], []
    for reading in (False, True):
        with Session(linked(fmu, algorithm=algorithm), engine=engine) as session:
            session.bias("a", "u", 0.25, factor=3.0)
            while not session.ended:
                if reading:
                    seen.append((session.time_ns, session.value("a", "x")))
                    session.override("b", "u", 7.0)
                    assert algorithm != "jacobi" or session.value("b", "u") == 7.0
                    session.release("b", "u")
                session.step()
            runs.append(session.result())
    assert rows(runs[0]) == rows(runs[1])
    values = dict(zip(runs[0].points_ns.tolist(), runs[0].signal("a", "x").tolist(), strict=True))
    assert seen == [(time_ns, values[time_ns]) for time_ns, _ in seen]


def test_override_bias_release(fmu: Path, engine: EngineName) -> None:
    with Session(linked(fmu), engine=engine) as session:
        session.run_until(1.0)
        k = session.rows
        session.override("b", "u", 7.0)
        session.bias("a", "x", 0.5, factor=2.0)
        session.step(5)
        session.release("b", "u")
        session.release("a", "x")
        session.run_until()
        run = session.result()
    plain = simulate(linked(fmu), engine="python")
    assert run.signal("b", "u")[:k].tolist() == plain.signal("b", "u")[:k].tolist()
    assert run.signal("b", "u")[k : k + 5].tolist() == [7.0] * 5
    assert 7.0 not in run.signal("b", "u")[k + 5 :]
    # what the others and the trace see of a is 2 x + 0.5; a itself goes on unmoved
    given = 2.0 * plain.signal("a", "x")[k] + 0.5
    assert run.signal("a", "x")[k] == given
    assert run.signal("a", "y")[k] == plain.signal("a", "y")[k]
    with (
        Session(linked(fmu)) as session,
        pytest.raises(InputError, match="no output or connected input"),
    ):
        session.override("a", "b", 1.0)


def test_an_override_after_going_back_is_in_the_rows(fmu: Path, engine: EngineName) -> None:
    """One before, at a later row, has had inputs copied from that row on alone."""
    wires = (("a.x", "b.u", None), ("b.x", "a.u", None))
    with Session(scalars(fmu, PAIR, wires, step=0.1, stop=2.0), engine=engine) as session:
        session.step(5)
        saved = session.snapshot()
        session.step(5)
        session.override("a", "u", 1.0)
        session.step(1)
        session.restore(saved)
        session.override("b", "u", 7.0)
        session.step(5)
        run = session.result()
    assert run.signal("b", "u")[5:10].tolist() == [7.0] * 5
    assert run.signal("a", "u")[5:10].tolist() == run.signal("b", "x")[5:10].tolist()


def test_stops_at_the_first_row_where_the_condition_is_true(fmu: Path, engine: EngineName) -> None:
    with Session(linked(fmu), engine=engine) as session:
        stopped = session.run_until(stop=lambda s: s.value("a", "x") < 0.5)
        run = session.result()
        assert stopped
        assert run.status == "stopped"
        values = run.signal("a", "x")
        assert values[-1] < 0.5
        assert (values[:-1] >= 0.5).all()
        assert not session.run_until()
        assert rows(session.result()) == rows(simulate(linked(fmu)))


class Wall:
    """A clock that only sleeping and working moves."""

    def __init__(self, work: Iterator[float]) -> None:
        self.now = 100.0
        self._work = work
        self.slept = 0.0

    def clock(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept += seconds

    def look(self, _session: Session) -> bool:
        self.now += next(self._work)
        return False


def test_pace_is_kept_and_overruns_are_counted(fmu: Path) -> None:
    """0.1 s points at twice real time: 50 ms each; one of them takes 130 ms."""
    work = [0.01] * 51
    work[20] = 0.13
    wall = Wall(iter(work))
    pace = Pace(2.0, clock=wall.clock, sleep=wall.sleep)
    system = scalars(fmu, PAIR, (("a.x", "b.u"),), step=0.1, stop=5.0)
    with Session(system) as session:
        session.run_until(pace=pace, stop=wall.look)
    assert pace.points == 51
    assert wall.now - 100.0 == pytest.approx(2.5 + 0.01)
    # `look` comes after the lateness of its own point is noted: 21, 22 and 23 begin late
    assert pace.largest_s == pytest.approx(0.08)
    assert pace.mean_s * 51 == pytest.approx(0.08 + 0.04)
    assert pace.late == 1
    with pytest.raises(InputError, match="positive factor"):
        Pace(0.0)
