"""Sessions execute the events of their scenario, as runs do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import SCENARIOS
from test_events import LOOP as PLAIN

from cosim import open_session
from cosim.core import InputError
from cosim.master import Run, Snapshot
from cosim.scenario import FmuCache, ScenarioSession, execute_unrecorded, load, prepare

LOOP = (
    PLAIN.replace(" LINK", "")
    + """
[[events]]
at = 0.55
for = "0.2 s"
override = { "plant.force.x" = "70 N" }

[[events]]
when = "plant.eta.x > 1.12 m"
trigger = "every-time"
for = "0.3 s"
bias = { "controller.eta.x" = { offset = "1 m", factor = 2.0 } }

[[events]]
at = 1.0
for = "0.4 s"
set = { "plant.disturbance.u" = 0.7 }
"""
)
STOPPING = '\n[[events]]\nwhen = "t > 1.5 s"\nstop = "enough"\n'


@contextmanager
def opened(text: str, fmus: Path, folder: Path) -> Iterator[ScenarioSession]:
    path = folder / "s.toml"
    path.write_text(text)
    with open_session(path, fmus=fmus.parent, flavour="python") as session:
        yield session


def run_of(text: str, fmus: Path, folder: Path) -> Run:
    (folder / "r.toml").write_text(text)
    loaded = load(str(folder / "r.toml"))
    prepared = prepare(loaded, FmuCache(fmus.parent, loaded.folder, flavour="python"))
    return execute_unrecorded(prepared)[1]


def rows(run: Run) -> list[bytes]:
    count = run.points_ns.size
    return [run.points_ns.tobytes(), *(i.rows[:count].tobytes() for i in run.instances)]


@pytest.mark.parametrize("how", ["at once", "step by step", "to instants between"])
def test_events_happen_as_in_a_run(fmus: Path, tmp_path: Path, how: str) -> None:
    with opened(LOOP, fmus, tmp_path) as session:
        if how == "step by step":
            while not session.ended:
                session.step()
        elif how == "to instants between":
            for seconds in (0.33, 0.55, 0.6, 1.0, 1.01, 1.6):
                session.run(seconds)
        session.run()
        found = session.result()
    expected = run_of(LOOP, fmus, tmp_path)
    assert (found.status, found.reason) == (expected.status, expected.reason)
    assert rows(found) == rows(expected)
    assert 70.0 in found.signal("plant", "force.x")


def test_events_at_the_time_of_the_session_have_happened(fmus: Path, tmp_path: Path) -> None:
    with opened(LOOP, fmus, tmp_path) as session:
        session.run(0.55)
        assert session["plant.force.x"] == 70.0
        session.run(1.0)
        assert session["plant.disturbance.u"] == 0.7
        session.run(1.4)
        assert session["plant.disturbance.u"] != 0.7
        assert session["plant.force.x"] != 70.0


def test_an_event_ends_the_session(fmus: Path, tmp_path: Path) -> None:
    with opened(LOOP + STOPPING, fmus, tmp_path) as session:
        session.run()
        assert session.ended
        found = session.result()
    expected = run_of(LOOP + STOPPING, fmus, tmp_path)
    assert (found.status, found.reason) == (expected.status, expected.reason) != ("finished", None)
    assert found.reason is not None
    assert "enough" in found.reason
    assert rows(found) == rows(expected)


@pytest.mark.parametrize("at", [0.3, 0.6, 1.2, 1.45])
@pytest.mark.parametrize("portable", [False, True])
def test_snapshots_contain_what_events_have_done(
    fmus: Path, tmp_path: Path, at: float, *, portable: bool
) -> None:
    with opened(LOOP, fmus, tmp_path) as session:
        session.run(at)
        before = session.save(portable=portable)
        session.run()
        first = session.result()
        expected = rows(first)
        session.restore(before)
        session.run()
        assert rows(session.result()) == expected
    if portable:
        before.save(tmp_path / "s.npz")
        with opened(LOOP, fmus, tmp_path) as other:
            other.restore(Snapshot.load(tmp_path / "s.npz"))
            other.run()
            assert rows(other.result()) == expected


@pytest.mark.parametrize("supervise", [False, True])
def test_who_goes_back_to_the_end_has_ended(supervise: bool, fmus: Path) -> None:  # noqa: FBT001 - drawn
    """Nothing is left to be done: no call runs for ever, and closing asks for no further point."""
    path = str(SCENARIOS / "valid" / "grid-events.toml")
    with open_session(path, fmus=fmus.parent, flavour=fmus.name, supervise=supervise) as session:
        session.run()
        end = session.save()
        rows = session.rows
        session.restore(end)
        assert (session.status, session.rows) == ("finished", rows)
        with pytest.raises(InputError, match="the run has ended"):
            session.step(3)
        session.run()
        assert session.result().status == "finished"


def test_a_snapshot_of_other_events_is_refused(fmus: Path, tmp_path: Path) -> None:
    with opened(LOOP, fmus, tmp_path) as session:
        session.run(0.6)
        saved = session.save(portable=True)
        session.run(0.9)
    later = LOOP.replace("at = 1.0", "at = 1.1").replace("eta.x > 1.12", "eta.x > 1.13")
    with opened(later, fmus, tmp_path) as other:
        with pytest.raises(InputError, match=r"other events|another system"):
            other.restore(saved)
        other.run()
        result: Any = other.result()
    assert np.isfinite(result.signal("plant", "eta.x")).all()
