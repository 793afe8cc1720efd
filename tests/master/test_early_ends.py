"""Runs that a slave ends, leaves early or answers strangely, or whose arithmetic it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from arithmetic import is_usual
from foreign.steered import CALLS, VERSIONS, parameters, steered_fmu
from scalar import end

from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import Component, Connection, EngineName, System, make_schedule, simulate

if TYPE_CHECKING:
    from cosim.master import Run

Engine = tuple[EngineName, int]
Fmus = dict[str, FmuDescription]
STEP_NS, END_NS = 250_000_000, 2_000_000_000


@pytest.fixture(scope="module")
def steered(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    """The FMU that does as it is told, of each version."""
    folder = tmp_path_factory.mktemp("steered")
    return {version: describe_fmu(steered_fmu(folder, version)) for version in VERSIONS}


@pytest.fixture(params=[("kernel", 1), ("kernel", 2), ("python", 1)])
def engine(request: pytest.FixtureRequest) -> Any:
    """Either engine, and the number of its threads."""
    return request.param


def run_of(
    fmu: FmuDescription, given: dict[str, float], engine: Engine, every_ns: int | None = None
) -> Run:
    """A run of 2 s in steps of 0.25 s, or of another step for the component."""
    schedule = make_schedule({}, STEP_NS, END_NS, "grid")
    parts = {"it": Component(fmu, given, every_ns=every_ns), "other": Component(fmu)}
    system = System(parts, [], {}, {}, schedule, 1e6, threads=engine[1])
    return simulate(system, engine=engine[0])


@pytest.mark.parametrize(
    ("at", "until", "every_ns", "words"),
    [
        (0.5, 0.6, None, ", computed until t = 0.6 s"),
        (0.5, 0.75, None, ""),
        (0.5, 0.75, 2 * STEP_NS, ", computed until t = 0.75 s"),
        (0.5, -1.0, None, ""),
        (1.75, 2.0, None, ""),
    ],
)
@pytest.mark.parametrize("version", VERSIONS)
def test_slave_ends_the_run(
    steered: Fmus,
    engine: Engine,
    version: str,
    at: float,
    until: float,
    every_ns: int | None,
    words: str,
) -> None:
    """By Discard or terminateSimulation: stopped, and until when it computed its own step."""
    status = 2 if version == "2.0" else 0
    given = parameters("step", status, at, ends=1, until=until)
    run = run_of(steered[version], given, engine, every_ns)
    assert run.status == "stopped"
    assert run.reason == f"component 'it' asked for the end in the step from t = {at:g} s{words}"
    assert run.points_ns[-1] == at * 1e9


@pytest.mark.parametrize("until", [1.9, 2.0])
def test_discard_at_the_end_of_the_run(steered: Fmus, engine: Engine, until: float) -> None:
    """FMI 2.0: it is none if the slave has computed all; else the run has failed."""
    run = run_of(steered["2.0"], parameters("step", 2, 1.75, until=until), engine)
    assert run.reason is not None
    if until == 2.0:
        assert run.status == "stopped"
        assert run.reason == (
            "component 'it' discarded the step from t = 1.75 s at the end of the run"
        )
    else:
        assert run.status == "failed"
        assert "returned fmi2Discard, having computed until t = 1.9 s" in run.reason


@pytest.mark.parametrize("status", [-1, -(2**31), 5, 77, *range(100, 106)])
@pytest.mark.parametrize("what", ["step", "get"])
@pytest.mark.parametrize("version", VERSIONS)
def test_unknown_status_fails_the_run(
    steered: Fmus, engine: Engine, version: str, what: str, status: int
) -> None:
    """It is named, with component, call and time."""
    run = run_of(steered[version], parameters(what, status, 0.5), engine)
    assert run.status == "failed"
    word = f"status {status}, which FMI does not know"
    if (version, status) == ("2.0", 5):
        word = "fmi2Pending"
    at = "from" if what == "step" else "at"
    assert f"component 'it' (steered.fmu): {what} {at} t = 0.5 s returned {word}" in str(run.reason)


def test_early_return_fails_the_run(steered: Fmus, engine: Engine) -> None:
    """FMI 3.0: it was not allowed."""
    run = run_of(steered["3.0"], parameters("step", 0, 0.5, early=1, until=0.6), engine)
    assert run.status == "failed"
    assert "step from t = 0.5 s ended early, which was not allowed" in str(run.reason)
    assert "got: t = 0.6 s" in str(run.reason)


@pytest.mark.parametrize("what", ["get", "set", "step"])
@pytest.mark.parametrize("version", VERSIONS)
def test_a_run_changes_no_arithmetic(
    steered: Fmus, engine: Engine, version: str, what: str
) -> None:
    """Neither of the other components, from the first call of the loop on, nor afterwards."""
    fmu = steered[version]
    schedule = make_schedule({}, STEP_NS // 10, END_NS, "grid")
    given = [parameters("nothing", 0, arithmetic=CALLS.index(one)) for one in (what, "nothing")]
    rows = []
    for first in given:
        parts = {"odd": Component(fmu, first), "even": Component(fmu, given[1])}
        wires = [Connection(end("odd.y"), end("even.u")), Connection(end("even.y"), end("odd.u"))]
        run = simulate(
            System(parts, wires, {}, {}, schedule, 1e6, threads=engine[1]), engine=engine[0]
        )
        assert is_usual()
        rows.append(run.signal("even", "y"))
    assert np.array_equal(*rows)
    assert rows[0][-1] != 0.0
