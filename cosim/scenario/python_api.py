"""Run scenarios from Python, or open them as sessions."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cosim.core import AnyPath, InputError, Progress, default_method, say_once
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.master import EngineName, Observer, Pace
from cosim.scenario.execute import assembled_system, execute_recorded, execute_unrecorded
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.in_python import Scenario
from cosim.scenario.interrupt import InterruptedRun
from cosim.scenario.preparation import PreparedScenario, prepare
from cosim.scenario.read import load, of_scenario
from cosim.scenario.row_observer import Row, RowObserver
from cosim.scenario.run_result import RunResult
from cosim.scenario.scenario_session import ScenarioSession
from cosim.scenario.schema import ScenarioPart
from cosim.scenario.session_in_python import Session
from cosim.scenario.supervised_session import SupervisedSession
from cosim.scenario.supervision import supervision_of
from cosim.trace import RowsInMemory

FMUS = Path("fmus")


def run(
    scenario: AnyPath | Scenario | ScenarioPart,
    trace: AnyPath | None = None,
    *,
    settings: Sequence[str] = (),
    fmus: AnyPath = FMUS,
    flavour: str = DEFAULT_FLAVOUR,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    supervise: bool | None = None,
    limits: Sequence[str] = (),
    keep: bool = True,
    on_row: Callable[[Row], object] | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Run a scenario, as `cosim run` does; return its outcome with its rows.

        >>> from cosim import run
        >>> result = run("paper-example", settings=["run.end=1"])
        >>> result.status, result["plant.x"].values.shape
        ('finished', (101, 2))
        >>> recorded = run("paper-example", "short.mcap", settings=["run.end='500 ms'"])
        >>> recorded.simulated_s, recorded.trace.name
        (0.5, 'short.mcap')

    Parameters
    ----------
    scenario : a built-in name, a file, or one that was built in Python.
    trace : file of the trace, from which the rows are then read; None: write none.
    settings : as `--set`, "links.uplink.delay='400 ms'".
    fmus : folder of the FMUs; missing ones are built there.
    flavour, engine, pace, limits : as the options of `cosim run`.
    supervise : run the components in a child process; None: as the scenario says, by default
        true.
    keep : keep the rows in memory, where no trace is written.
    on_row : called with each row as it becomes complete.
    progress : called as the run goes on, with the phase, the amount done and the total.

    Raises
    ------
    InputError, ComponentError, NotAchievableError, LossError : see `prepare` and `execute_run`.
    KeyboardInterrupt : after Ctrl-C; after a supervised run, its `outcome` is the run so far. At a
        prompt and in a notebook the run so far is returned instead.
    """
    if supervise and isinstance(scenario, Scenario):
        scenario.check_forks("a child process", "supervise", "supervise=False")
    prepared = _prepared(scenario, settings, fmus, flavour)
    supervision = supervision_of(prepared.loaded.scenario, limits, supervise=supervise)
    rows = RowsInMemory(prepared.loaded.name) if keep and trace is None else None
    into = rows if trace is None else Path(trace)
    observers = () if on_row is None else (RowObserver(on_row),)
    given: dict[str, Any] = {
        "progress": progress,
        "engine": engine,
        "pace": pace,
        "supervision": supervision,
        "observers": observers,
    }
    try:
        if into is None:
            outcome = execute_unrecorded(prepared, keep=False, **given)[0]
        else:
            outcome = execute_recorded(prepared, into, **given)[0]
    except InterruptedRun as interrupted:
        interrupted.outcome = RunResult.of(interrupted.outcome, rows)
        if hasattr(sys, "ps1"):  # a person is there to look at it
            return interrupted.outcome
        raise
    return RunResult.of(outcome, rows)


@contextmanager
def open_session(
    scenario: AnyPath | Scenario | ScenarioPart,
    *,
    settings: Sequence[str] = (),
    fmus: AnyPath = FMUS,
    flavour: str = DEFAULT_FLAVOUR,
    engine: EngineName = "auto",
    observers: Sequence[Observer] = (),
    supervise: bool | None = None,
    limits: Sequence[str] = (),
) -> Iterator[Session]:
    """Open a scenario as a session at its start, designed and initialised.

        >>> from cosim import DelaySystem, Scenario, open_session
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> with open_session(tank, settings=["run.end=1"]) as session:
        ...     stopped = session.run("200 ms")
        ...     session["tank.u"] = [1.0]
        ...     session.step(3)
        ...     session.time, session.rows, session["tank.x"].shape
        (0.5, 5, (1,))

    Its events happen as in a run. Parameters as for `run`; `observers` receive its rows and log
    lines. As those of a run, its components are in a child process, within the limits, unless
    `supervise` or the scenario says otherwise, or the system has no way to it (Windows).

    Raises
    ------
    InputError, ComponentError : as `run`; a ComponentError too where closing it ends the process
        of a component.
    """
    if supervise and isinstance(scenario, Scenario):
        scenario.check_forks("a child process", "supervise", "supervise=False")
    prepared = _prepared(scenario, settings, fmus, flavour)
    supervision = supervision_of(prepared.loaded.scenario, limits, supervise=supervise)
    system, events = assembled_system(prepared)
    session: ScenarioSession | SupervisedSession
    supervised = supervision.supervised
    if supervised and default_method() == "spawn" and supervise is None:
        say_once("sessions run in this process on this system; supervise=True asks for a child")
        supervised = False
    if supervised:
        session = SupervisedSession(
            system, events, observers, engine=engine, limits=supervision.limits
        )
    else:
        limit = supervision.limits.call
        session = ScenarioSession(system, events, observers, engine=engine, call_limit=limit)
    with session:
        yield Session(session)
    if session.end_failure is not None:
        raise session.end_failure


def _prepared(
    scenario: AnyPath | Scenario | ScenarioPart,
    settings: Sequence[str],
    fmus: AnyPath,
    flavour: str,
) -> PreparedScenario:
    if isinstance(scenario, ScenarioPart):
        if settings:
            raise InputError(
                "settings apply to scenarios that are read from a file or by name",
                where="settings",
                hint="scenario.model_copy(update=...)",
            )
        loaded = of_scenario(scenario, "scenario")
    elif isinstance(scenario, Scenario):
        loaded = scenario.loaded(flavour, settings)
    else:
        loaded = load(str(scenario), settings)
    return prepare(loaded, FmuCache(Path(fmus), loaded.folder, flavour=flavour))
