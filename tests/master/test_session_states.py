"""What each call of a session does in each state: the table of docs/reference/outcomes.md."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from scalar import end, ns

from cosim.core import ComponentError, CosimError, InputError
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    EngineName,
    Session,
    Snapshot,
    System,
    make_schedule,
)
from cosim.scenario import Session as Face, SupervisedSession

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "outcomes.md"
FAULTS = {
    "error": misbehaviour("error", "step", at=0.5),
    "fatal": misbehaviour("fatal", "step", at=0.5),
    "nan": misbehaviour("not-a-number", "get", at=0.5),
    "segfault": misbehaviour("segfault", "step", at=0.5),
}
"""How a component fails."""


def table() -> dict[str, dict[str, str]]:
    """State and what is done, by call."""
    text = PAGE.read_text("utf-8").split("## States of a session")[1].split("\n- loading")[0]
    lines = [[c.strip() for c in x.strip("|").split("|")] for x in text.splitlines() if "|" in x]
    heads, _, *rows = lines
    return {
        name.strip("` "): dict(zip(heads[1:], cells, strict=True))
        for first, *cells in rows
        for name in first.split(",")
    }


TABLE = table()
CALLS: dict[str, Callable[[Face, Any], Any]] = {
    "step": lambda s, _: s.step(),
    "run": lambda s, _: s.run(2.0),
    "session[name]": lambda s, _: s["s.x"],
    "link_state": lambda s, _: s.link_state("nothing"),
    "session[name] = value": lambda s, _: s.__setitem__("s.x0", 0.1),
    "bias": lambda s, _: s.bias("s.x", 1.0),
    "release": lambda s, _: s.release("s.x"),
    "reset": lambda s, _: s.reset("s"),
    "note": lambda s, _: s.note("info", "a note"),
    "save": lambda s, _: s.save(),
    "restore": lambda s, kept: s.restore(kept),
    "result": lambda s, _: s.result(),
    "members": lambda s, _: s.members("s.x"),
    "time": lambda s, _: s.time,
    "rows": lambda s, _: s.rows,
    "ended": lambda s, _: s.ended,
    "status": lambda s, _: s.status,
}


MAKERS: dict[str, Callable[[System], Session | SupervisedSession]] = {
    "here": Session,
    "child": SupervisedSession,
}
"""Sessions whose components are in this process, and in a child."""


def pair(folder: Path, fault: str = "", *, isolate: bool = False) -> System:
    """`h` may misbehave; `s` gets its output."""
    fmu = describe_fmu(hostile_fmu(folder, "2.0"))
    bad = {**FAULTS[fault], "x0": 1.0} if fault else {"x0": 1.0}
    components = {
        "h": Component(fmu, bad, isolate=isolate),
        "s": Component(fmu, {"x0": 0.5}),
    }
    wires = [Connection(end("h.x"), end("s.u")), Connection(end("s.x"), end("h.u"))]
    return System(components, wires, {}, {}, make_schedule({}, ns(0.1), ns(1.0), "grid"))


@contextmanager
def in_state(
    state: str, folder: Path, fault: str, place: str = "here"
) -> Iterator[tuple[Session | SupervisedSession, Snapshot | None]]:
    """A session in a state, and a snapshot that it took."""
    isolate = (fault, place) == ("segfault", "here")  # else it would end the tests
    session = MAKERS[place](pair(folder, fault if state == "failed" else "", isolate=isolate))
    if state == "loading":
        yield session, None
        return
    with session:
        session.run_until(0.3)
        kept = session.snapshot()
        if state == "ended":
            session.run_until()
        if state == "failed":
            with pytest.raises(ComponentError):
                session.run_until()
        if state != "closed":
            yield session, kept
    if state == "closed":
        yield session, kept


def answer(call: str, session: Session | SupervisedSession, kept: Any) -> str:
    """What a call does, in the words of the table."""
    try:
        CALLS[call](Face(session), kept)  # type: ignore[arg-type] # without the events of a scenario
    except InputError as error:
        inside = ("not open", "closed", "has ended")
        return "refused" if any(word in str(error) for word in inside) else "done"
    except ComponentError:
        return "raises"
    return "done"


def test_the_table_has_every_call() -> None:
    assert list(TABLE) == list(CALLS)


@pytest.mark.parametrize("place", MAKERS)
@pytest.mark.parametrize("state", ["loading", "running", "ended", "closed"])
def test_each_call_does_what_the_table_says(state: str, place: str, tmp_path: Path) -> None:
    for call in CALLS:
        with in_state(state, tmp_path, "", place) as (session, kept):
            assert (call, answer(call, session, kept)) == (call, TABLE[call][state])


@pytest.mark.parametrize("place", MAKERS)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_failed_session_raises_from_every_call(fault: str, place: str, tmp_path: Path) -> None:
    """Again and again; what it has recorded is there."""
    with in_state("failed", tmp_path, fault, place) as (session, kept):
        assert session.status == "failed"
        for call in [*CALLS, *CALLS]:
            if call == "restore" and fault == "nan":
                continue  # all components are alive
            expected = TABLE[call]["failed"]
            assert (call, answer(call, session, kept)) == (call, expected)
        with pytest.raises(ComponentError) as caught:
            session.step()
        assert caught.value.component == "h"
        run = session.result()
        assert (run.status, run.cause is not None and run.cause.component) == ("failed", "h")
        assert run.points_ns[-1] >= ns(0.4)
        assert run.signal("s", "x").size == run.count


@pytest.mark.parametrize("place", MAKERS)
def test_what_is_alive_can_go_back_from_a_failure(place: str, tmp_path: Path) -> None:
    with in_state("failed", tmp_path, "nan", place) as (session, kept):
        assert kept is not None
        session.restore(kept)
        assert session.status == "running"
        session.step()
        with pytest.raises(ComponentError):
            session.run_until()


def test_a_loop_over_the_time_of_a_failed_session_ends(tmp_path: Path) -> None:
    """Its time stands; the call raises."""
    with Session(pair(tmp_path, "error")) as session, pytest.raises(ComponentError, match="h"):  # noqa: PT012
        while session.time_s < 1.0:
            session.step()


def test_a_failure_in_a_call_between_two_steps_fails_the_session(tmp_path: Path) -> None:
    """The kernel would call it at its address."""
    fmu = describe_fmu(hostile_fmu(tmp_path, "2.0"))
    system = pair(tmp_path)
    system.components["h"] = Component(fmu, {**misbehaviour("error", "get", at=0.3), "x0": 1.0})
    with Session(system) as session:
        with contextlib.suppress(CosimError):
            while session.time_s < 0.9:
                session.step()
                session.read("h", "x")
        assert session.status == "failed"
        with pytest.raises(ComponentError):
            session.step()
        assert session.result().status == "failed"


@pytest.mark.parametrize("engine", ["python", "kernel"])
def test_results_own_their_rows(tmp_path: Path, engine: EngineName) -> None:
    """What was faulty stays so when the session goes back and on without the fault, and closes."""
    with Session(pair(tmp_path), engine=engine) as session:
        session.run_until(0.3)
        before = session.snapshot()
        session.bias("h", "x", 5.0)
        session.run_until()
        faulty = session.result()
        seen = [faulty.signal(c, v).copy() for c, v in (("h", "x"), ("s", "u"), ("s", "x"))]
        session.restore(before)
        session.run_until()
        healthy = session.result()
    again = [faulty.signal(c, v) for c, v in (("h", "x"), ("s", "u"), ("s", "x"))]
    assert [a.tolist() for a in again] == [a.tolist() for a in seen]
    assert faulty.signal("s", "u")[5] > 4.0 > healthy.signal("s", "u")[5]
