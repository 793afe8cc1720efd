"""What `run` returns: rows in memory, equal to those of a trace; rows as they come."""

from __future__ import annotations

import asyncio
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from shared import fmu_store

from cosim import DelaySystem, Scenario, run, run_async
from cosim.core import InputError
from cosim.scenario import RunResult
from cosim.trace import RowsInMemory, Trace

LINKED = "auv-acoustic"
SETTINGS = ["run.end=12"]


def fly(name: str = LINKED, trace: Path | None = None, **more: Any) -> RunResult:
    return run(name, trace, settings=SETTINGS, fmus=fmu_store("native"), **more)


@pytest.fixture(scope="module")
def in_memory() -> RunResult:
    return fly()


@pytest.fixture(scope="module")
def in_file(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return fly(trace=tmp_path_factory.mktemp("run") / "a.mcap")


@pytest.mark.parametrize("supervise", [False, True])
@pytest.mark.parametrize("name", [LINKED, "slots-against-random-access"])
def test_rows_in_memory_are_those_of_the_trace(name: str, supervise: bool, tmp_path: Path) -> None:  # noqa: FBT001
    """Every topic of components and links, to the last bit; the figures too."""
    mine = fly(name, supervise=supervise)
    file = fly(name, tmp_path / "a.mcap")
    assert isinstance(mine.rows, RowsInMemory)
    assert isinstance(file.rows, Trace)
    found, expected = mine.read_all(), file.read_all()
    recorded = {t for t, info in file.topics.items() if not info.is_computed and t != "/log"}
    assert recorded <= set(found)
    for topic, table in found.items():
        other = expected[topic]
        assert np.array_equal(table.log_time_ns, other.log_time_ns)
        assert np.array_equal(table.publish_time_ns, other.publish_time_ns)
        assert np.array_equal(table.sequence, other.sequence)
        for column, values in table.columns.items():
            assert values.dtype == other[column].dtype
            same = np.array_equal(values, other[column], equal_nan=values.dtype.kind == "f")
            assert same, (topic, column)
    assert (mine.metrics, mine.links) == (file.metrics, file.links)


def test_curves_are_those_of_the_rows(in_memory: RunResult) -> None:
    """A signal in axes of its own, a group with a line for each; stepwise where values hold."""
    pose, force = in_memory.plot("plant.eta", "controller")
    assert [line.get_label() for line in pose.get_lines()] == [
        f"eta.{a}" for a in ["x", "y", "z", "psi"]
    ]
    assert np.array_equal(pose.get_lines()[0].get_ydata(), in_memory["plant.eta.x"].values)
    assert pose.get_lines()[0].get_drawstyle() == "default"
    assert force.get_lines()[0].get_drawstyle() == "steps-post"
    assert in_memory["plant.eta.psi"].plot().get_ylabel() == "eta.psi [rad]"
    assert len(in_memory.plot()) == 3
    with pytest.raises(InputError, match="no signal 'plont'"):
        in_memory.plot("plont")


@pytest.mark.parametrize("supervise", [True, False])
def test_who_cancels_a_run_ends_it(supervise: bool, tmp_path: Path) -> None:  # noqa: FBT001
    """In the background as in the foreground; what was recorded stays."""
    options = {"settings": ["run.end=1e5"], "fmus": fmu_store("native"), "supervise": supervise}

    async def begun_and_cancelled() -> None:
        going = asyncio.Event()
        loop = asyncio.get_running_loop()
        flight = asyncio.ensure_future(
            run_async(
                LINKED,
                tmp_path / "a.mcap",
                progress=lambda *_: loop.call_soon_threadsafe(going.set),
                **options,
            )
        )
        await going.wait()
        flight.cancel()
        with pytest.raises(asyncio.CancelledError):
            await flight

    before = {one.pid for one in psutil.Process().children(recursive=True)}
    asyncio.run(begun_and_cancelled())
    assert {one.pid for one in psutil.Process().children(recursive=True)} <= before
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap.partial"]


def test_signals_and_groups_are_read_by_their_names(in_memory: RunResult) -> None:
    """As a connection names them; a group has a column for each signal."""
    found = in_memory
    group = found["plant.eta"]
    assert group.values.shape == (len(found["plant.eta.x"]), 4)
    assert np.array_equal(group.values[:, 0], found["plant.eta.x"].values)
    assert group.delivered[-1] == 12.0
    assert "plant.eta" in found
    assert "plant.eta.x" in list(found)
    assert "plant.etta" not in found
    with pytest.raises(InputError, match=r"plant\.etta"):
        found["plant.etta"]
    with pytest.raises(InputError, match="a group of several topics"):
        found["controller"]
    frame = found.to_pandas(["plant.eta", "controller.force"], align=0.5)
    assert frame.shape == (25, 7)


def test_ages_and_losses_of_links_are_those_of_the_trace(
    in_memory: RunResult, in_file: RunResult
) -> None:
    for a, b in zip(in_memory.age("uplink"), in_file.age("uplink"), strict=True):
        assert np.array_equal(a, b, equal_nan=True)
    assert len(in_memory.dropped("uplink")) == len(in_file.dropped("uplink")) > 0


def test_a_result_is_pickled_with_its_rows(in_memory: RunResult, in_file: RunResult) -> None:
    """To another process, in memory and as a file."""
    for found in (in_memory, in_file):
        again = pickle.loads(pickle.dumps(found))  # noqa: S301 - our own
        assert np.array_equal(again["plant.eta"].values, found["plant.eta"].values)
        assert again.status == found.status == "finished"


@pytest.mark.parametrize("keep", [False, True])
def test_each_row_is_handed_on_as_it_becomes_complete(keep: bool) -> None:  # noqa: FBT001
    seen: list[tuple[float, float, float]] = []
    found = fly(
        keep=keep,
        on_row=lambda row: seen.append((row.t, row["plant.eta.x"], *row["plant.eta"][:1])),
    )
    assert seen[-1][0] == 12.0
    assert [t for t, *_ in seen] == sorted(t for t, *_ in seen)
    assert all(x == y for _, x, y in seen)
    if keep:
        assert [x for _, x, _ in seen] == found["plant.eta.x"].values.tolist()


def test_a_function_for_rows_that_raises_ends_the_run() -> None:
    def refuse(row: Any) -> None:
        if row.t >= 3.0:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        fly(on_row=refuse)


def test_without_rows_it_says_so() -> None:
    found = fly(keep=False)
    assert found.status == "finished"
    with pytest.raises(InputError, match="were not kept"):
        found["plant.eta.x"]


def test_it_shows_itself_in_a_line_and_in_a_table(in_memory: RunResult) -> None:
    found = in_memory
    assert repr(found) == f"<RunResult {LINKED}: {found.headline} at 12 s, 62 signals>"
    assert "/plant/output" in found._repr_html_()


@pytest.mark.parametrize("supervise", [True, False])
def test_an_assertion_that_failed_has_the_values_of_what_it_names(supervise: bool) -> None:  # noqa: FBT001
    """At the point that decided it; what holds, and what is not finite, has none."""
    lag = Scenario(step=0.1, until=2).add("lag", DelaySystem([[-1.0]]), initial=[1.0])
    found = run(
        lag.require("lag.x[1] > 0.5", name="half").require("lag.x[1] > 0"), supervise=supervise
    )
    half, positive = found.assertions
    x = found["lag.x[1]"]
    at = int(np.flatnonzero(x.values <= 0.5)[0])
    assert (half.result, half.at_s) == ("fails", x.delivered[at])
    assert half.values == {"lag.x[1]": x.values[at]}
    assert half.place == f" at 0.7 s: lag.x[1] = {x.values[at]:.4g}"
    assert (positive.values, positive.place) == ({}, "")
    assert found.to_json()["assertions"][0]["values"] == half.values
