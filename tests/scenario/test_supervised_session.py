"""Sessions in a child process: the same answers as in one process, and failures that are told."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from cli.shell import SCENARIOS
from diary import Diary
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from shared import sampled

from cosim import open_session
from cosim.core import ComponentError, CosimError, InputError
from cosim.master import Pace, Snapshot

PUMP = """
title = "A pump"
[run]
end = {end}
step = 0.1
[components.pump]
fmu = "pump.fmu"
parameters = {{ u = 2.0, {fault} }}
[components.sound]
fmu = "sound.fmu"
parameters = {{ u = 1.0 }}
[[connections]]
from = "pump.x"
to = "sound.u"
{limits}
"""


def pump(
    folder: Path, fault: str = "nothing", call: str = "step", *, end: float = 1.0, limits: str = ""
) -> Path:
    """A pump that misbehaves from 0.45 s on, and a component that hears it."""
    for name in ("pump", "sound"):
        hostile_fmu(folder, "2.0", name)
    given = misbehaviour(fault, call, at=0.45 if call in ("step", "get") else 0.0)
    text = ", ".join(f"{name} = {value}" for name, value in given.items())
    path = folder / "s.toml"
    path.write_text(PUMP.format(fault=text, end=end, limits=limits))
    return path


class Rewound(Diary):
    """One that lets rows be computed anew."""

    def rewind(self, complete: int) -> None:
        self.rows = complete


Act = Callable[[Any, dict[str, Any]], Any]


def acts(draw: random.Random, session: Any) -> list[Act]:
    """Calls at random, as a user makes them."""
    names = [
        f"{name}.{port.name}"
        for name, component in session.system.components.items()
        for port in component.description.ports.values()
        if port.causality in ("output", "input")
    ]
    links = [*session.system.links, "no such"]

    def keep(s: Any, kept: dict[str, Any], portable: bool) -> None:  # noqa: FBT001 - drawn
        kept["it"] = s.save(portable=portable)

    def go_back(s: Any, kept: dict[str, Any]) -> None:
        if "it" in kept:
            s.restore(kept["it"])

    found: list[Act] = []
    for _ in range(25):
        a, b = draw.uniform(-1.0, 1.0), draw.uniform(0.1, 2.0)
        n, portable = draw.randint(1, 7), draw.random() < 0.5
        place = draw.choice(names)
        name = place.partition(".")[0]
        link = draw.choice(links)
        found.append(
            draw.choice(
                [
                    lambda s, _, n=n: s.step(n),
                    lambda s, _, b=b: s.run(s.time + b),
                    lambda s, _, b=b, w=place: s.run(
                        s.time + b, stop=lambda one, w=w: one[w] > 0.5
                    ),
                    lambda s, _, w=place: s[w],
                    lambda s, _, w=place, a=a: s.__setitem__(w, a),
                    lambda s, _, w=place, a=a: s.bias(w, a, 0.9),
                    lambda s, _, w=place: s.release(w),
                    lambda s, _, a=a: s.__setitem__("plant.no such", a),
                    lambda s, _, name=name: s.reset(name),
                    lambda s, _, link=link: s.link_state(link),
                    lambda s, _: s.note("info", "a note"),
                    lambda s, kept, p=portable: keep(s, kept, p),
                    go_back,
                    lambda s, _: facts(s.result()),
                    lambda s, _: facts(s.result(complete=True)),
                ]
            )
        )
    return found


def facts(run: Any) -> Any:
    """All that a result says."""
    count = run.points_ns.size
    rows = [run.points_ns.tobytes(), *(i.rows[:count].tobytes() for i in run.instances)]
    arrivals = {name: repr(one.arrivals()) for name, one in run.deliveries.items()}
    return run.status, run.reason, run.cause, run.statistics, arrivals, rows


def plain(found: Any) -> Any:
    return tuple(one.tolist() for one in found) if hasattr(found, "_fields") else found


def answers_of(path: str, seed: int, fmus: Path, *, supervise: bool) -> list[Any]:
    """Answers, errors and log lines of a session with calls at random."""
    diary, kept, answers = Rewound(), {}, []
    given = {"fmus": fmus, "flavour": "native", "supervise": supervise}
    with open_session(path, observers=[diary], **given) as session:  # type: ignore[arg-type]
        for act in acts(random.Random(seed), session):  # noqa: S311 - no secret
            try:
                found = plain(act(session, kept))
            except CosimError as error:
                found = (type(error).__name__, error.text())
            state = (
                session.status,
                session.ended,
                session.time,
                session.rows,
                session.end_reason,
            )
            answers.append((found, state))
        answers.append(facts(session.result()))
    return [*answers, diary.lines, diary.rows]


FAULTY = (1, 38, 172, 865)
"""Of calls at random: the first ones, an override after going back, a delay that is refused as
another link sends, a reset after a result."""
CASES = ("grid-events", "delays-that-vary", "events-of-every-kind", "over-a-transport-link")


@pytest.mark.parametrize("name", sampled(CASES, 1))
@pytest.mark.parametrize(
    "seed", [*FAULTY, *(pytest.param(s, marks=pytest.mark.slow) for s in range(2, 38))]
)
def test_calls_at_random_have_the_same_answers(native_fmus: Path, name: str, seed: int) -> None:
    """Values, errors, results, log lines, before and after snapshots, events and live links."""
    path = str(SCENARIOS / "valid" / f"{name}.toml")
    here, there = (answers_of(path, seed, native_fmus.parent, supervise=s) for s in (False, True))
    for one, other in zip(here, there, strict=True):
        assert one == other


FAULTS = {"segfault": "SIGSEGV", "exit-0": "exit code 0", "abort": "SIGABRT", "hang": "no answer"}


@pytest.mark.parametrize("fault", sampled(FAULTS, 2))
@pytest.mark.parametrize("call", ["step", "get"])
def test_what_ends_the_process_is_an_error_of_this_and_every_later_call(
    tmp_path: Path, fault: str, call: str
) -> None:
    """Component, call and cause are named; rows are kept; nothing is left."""
    path = pump(tmp_path, fault, call, limits='[limits]\ncall = "1 s"\n')
    before = {one.pid for one in psutil.Process().children(recursive=True)}
    with open_session(path) as session:
        session.run(0.3)
        for attempt in (session.run, session.step, session.step, session.run):
            with pytest.raises(ComponentError, match=FAULTS[fault]) as caught:
                attempt()
            assert caught.value.component == "pump"
            assert caught.value.call == ("fmi2DoStep" if call == "step" else "fmi2GetReal")
        for wrong in (
            lambda: session["sound.x"],
            lambda: session.__setitem__("sound.decay", 0.1),
            session.save,
        ):
            with pytest.raises(ComponentError, match=FAULTS[fault]):
                wrong()
        assert (session.status, session.ended) == ("failed", True)
        found = session.result()
    assert found.points_ns.size == (6 if call == "step" else 5)
    assert found.cause is not None
    assert found.cause.component == "pump"
    assert {one.pid for one in psutil.Process().children(recursive=True)} <= before


@pytest.mark.parametrize("call", ["enter", "exit"])
def test_death_at_the_start_is_an_error(tmp_path: Path, call: str) -> None:
    path = pump(tmp_path, "segfault", call)
    with pytest.raises(ComponentError, match="SIGSEGV") as caught, open_session(path):
        pass
    assert caught.value.component == "pump"


@pytest.mark.parametrize("call", ["terminate", "free"])
def test_death_at_the_end_takes_nothing_from_the_result(tmp_path: Path, call: str) -> None:
    """It is raised as the block is left, unless that raises something itself."""
    with (  # noqa: PT012
        pytest.raises(ComponentError, match="exit code 3") as caught,
        open_session(pump(tmp_path, "exit-3", call)) as session,
    ):
        session.run()
        found = session.result()
    assert (caught.value.component, caught.value.kind) == ("pump", "exited")
    assert (found.status, found.points_ns.size) == ("finished", 11)
    with pytest.raises(ZeroDivisionError), open_session(pump(tmp_path, "exit-3", call)):
        raise ZeroDivisionError


def test_results_are_their_own_and_calls_after_the_end_are_refused(tmp_path: Path) -> None:
    with open_session(pump(tmp_path)) as session:
        session.run(0.5)
        kept = session.result()
        saved = session.save()
        rows = kept.signal("pump", "x").tobytes()
        session["pump.x"] = 5.0
        session.run()
        session.restore(saved)
        session.run()
    assert kept.signal("pump", "x").tobytes() == rows
    for wrong in (session.step, session.result, session.run, session.save):
        with pytest.raises(InputError, match="closed"):
            wrong()
    with pytest.raises(InputError, match="closed"):
        session["pump.x"]


def test_snapshots_go_from_one_kind_to_the_other(tmp_path: Path, native_fmus: Path) -> None:
    """Portable ones; one that is bound to its session is refused by another."""
    path = SCENARIOS / "valid" / "grid-events.toml"
    fmus = native_fmus.parent
    ends = []
    with open_session(path, fmus=fmus, flavour="native") as session:
        session.run(0.5)
        bound, portable = session.save(), session.save(portable=True)
        portable.save(tmp_path / "s.npz")
        with pytest.raises(InputError, match="bound to its session"):
            bound.save(tmp_path / "t.npz")
        session.run()
        ends.append(session["plant.x[1]"])
    for supervise in (True, False):
        with open_session(path, fmus=fmus, flavour="native", supervise=supervise) as other:
            other.restore(Snapshot.load(tmp_path / "s.npz"))
            other.run()
            ends.append(other["plant.x[1]"])
            if supervise:
                with pytest.raises(InputError, match="another session"):
                    other.restore(bound)
    assert len(set(ends)) == 1


def test_ctrl_c_stops_between_two_steps_and_the_session_goes_on(tmp_path: Path) -> None:
    """As in one process: KeyboardInterrupt, and nothing is lost."""
    with open_session(pump(tmp_path, "sleep", end=1000.0)) as session:
        timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            session.run()
        timer.join()
        reached = session.time
        assert 0.0 < reached < 1000.0
        session.step()
        assert session.time == pytest.approx(reached + 0.1)


def test_ctrl_c_ends_a_call_that_does_not_return(tmp_path: Path) -> None:
    with open_session(pump(tmp_path, "hang-deaf")) as session:
        timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            session.run()
        timer.join()
        with pytest.raises(ComponentError, match="interrupted"):
            session.step()
        assert session.result().points_ns.size == 6


@pytest.mark.parametrize("call", ["enter", "exit"])
def test_ctrl_c_while_it_is_opened_is_an_interruption(call: str, tmp_path: Path) -> None:
    """Not the failure of the run that it ends."""
    path = pump(tmp_path, "hang-deaf", call=call)
    timer = threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt), open_session(path):
        pytest.fail("it hangs as it is opened")
    timer.join()


def test_pace_is_kept(tmp_path: Path) -> None:
    pace = Pace(2.0)
    with open_session(pump(tmp_path)) as session:
        began = time.monotonic()
        session.run(pace=pace)
        assert time.monotonic() - began >= 0.45
    assert pace.points == 11


def test_a_scenario_can_say_that_its_session_is_in_this_process(tmp_path: Path) -> None:
    path = pump(tmp_path)
    path.write_text(path.read_text().replace("step = 0.1", "step = 0.1\nsupervise = false"))
    before = {one.pid for one in psutil.Process().children(recursive=True)}
    with open_session(path) as session:
        session.run(0.5)
        assert {one.pid for one in psutil.Process().children(recursive=True)} <= before


def test_a_second_thread_is_refused_while_a_call_lasts(tmp_path: Path) -> None:
    """By name, as in a session in one process."""
    with open_session(pump(tmp_path, "sleep", end=20.0)) as session:
        thread = threading.Thread(target=lambda: session.run(2.0))
        thread.start()
        refused = None
        while thread.is_alive() and refused is None:
            try:
                session["pump.x"]
            except InputError as error:
                refused = error
        thread.join()
        assert "another thread" in str(refused)
        assert session.time == pytest.approx(2.0)
