"""A session by the names of its signals: `session["plant.x"]`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from shared import fmu_store

from cosim import open_session
from cosim.core import InputError


@pytest.fixture(params=[False, True], ids=["here", "in a child"])
def session(request: Any) -> Iterator[Any]:
    with open_session("auv-acoustic", fmus=fmu_store("native"), supervise=request.param) as opened:
        yield opened


def test_a_signal_is_a_number_and_a_group_an_array(session: Any) -> None:
    session.run(1.0)
    rows = session.result()
    pose = [rows.signal("plant", f"eta.{axis}")[-1] for axis in ("x", "y", "z", "psi")]
    assert session["plant.eta.x"] == pose[0] != 0.0
    assert session["plant.eta"].tolist() == pose
    assert session.members("plant.eta") == [f"plant.eta.{axis}" for axis in ("x", "y", "z", "psi")]
    assert session["controller.sample_time"] == 0.05


def test_what_is_assigned_acts_from_the_next_point_on(session: Any) -> None:
    """A connected input is replaced, a group by a sequence, and released as any override."""
    session["plant.force"] = [1.0, 2.0, 3.0]
    session.step()
    assert session["plant.force"].tolist() == [1.0, 2.0, 3.0]
    session["plant.force.x"] = 7.0
    session.step()
    assert session["plant.force"].tolist() == [7.0, 2.0, 3.0]
    session.release("plant.force.x")
    session.run(5.0)
    assert session["plant.force.x"] != 7.0


def test_the_run_goes_on_as_by_the_longer_calls(session: Any) -> None:
    before = session.save()
    session["plant.force.x"] = 5.0
    session.run(3.0)
    found = session["plant.eta"]
    session.restore(before)
    session["plant.force.x"] = 5.0
    session.run(3.0)
    assert np.array_equal(session["plant.eta"], found)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("plont.eta", None, "no component 'plont'"),
        ("plant", None, "a component, not a variable"),
        ("plant.etta", None, "no variable 'etta'"),
        ("plant.force", [1.0], "do not match"),
    ],
)
def test_what_there_is_not_is_refused(session: Any, name: str, value: Any, message: str) -> None:
    ask = (lambda: session[name]) if value is None else (lambda: session.__setitem__(name, value))
    with pytest.raises(InputError, match=message):
        ask()
