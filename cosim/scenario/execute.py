"""Run a prepared scenario: the run itself, its zero-state run, metrics and trace."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from cosim.core import ComponentError, Findings, Progress, check_output, silent
from cosim.master import (
    EngineName,
    Observer,
    Pace,
    Run,
    Supervisor,
    System,
    TraceRecorder,
)
from cosim.scenario.assembly import assemble, same_start
from cosim.scenario.assertions import bind_assertions
from cosim.scenario.binary_origins import binary_origins
from cosim.scenario.guarantee.law_measures import LawMeasures, MeasuredLaw
from cosim.scenario.guarantee.verdict import LoopOfRun, loop_of_run
from cosim.scenario.metrics import final_values, metrics_of, status_of
from cosim.scenario.outcome import Outcome, result_entries
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.run_context import RunContext
from cosim.scenario.run_events import EventCollector
from cosim.scenario.run_measures import (
    OF_GUARANTEE,
    RunMeasures,
    ZeroStateFigures,
    ZeroStateMeasures,
    loop_of,
)
from cosim.scenario.run_metadata import run_metadata_of
from cosim.scenario.run_series import RunSeries
from cosim.scenario.script import Event, Machine, changed_by, script_of
from cosim.scenario.supervision import Supervision, raise_if_interrupted, supervision_of
from cosim.scenario.system_run import run_system
from cosim.scenario.wanted import ALL_FIGURES, Wanted
from cosim.trace import RowsInMemory, RunOutcome, TraceWriter
from cosim.trace.outcome import Cause


def execute_run(
    prepared: PreparedScenario,
    trace: Path | None = None,
    *,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    fsync: bool = False,
    supervision: Supervision | None = None,
) -> Outcome:
    """Run the scenario and its zero-state run, write the trace, and end the slaves.

    In a child process the slaves are ended before the trace is finished, which then says if that
    failed; in this process afterwards, since some FMUs end the process with themselves. An FMU
    that allows one instance per process is ended before the zero-state run begins.

    `engine` affects speed only: "kernel", "python", or "auto". `pace` slows the run (not the
    zero-state run) down to wall-clock time; `fsync` as for `TraceWriter`; `supervision` overrides
    what the scenario says.

    Raises
    ------
    InputError, ComponentError, LossError : what was recorded before is on disk.
    InterruptedRun, TerminatedRun : after Ctrl-C or SIGTERM in a supervised run; the trace is
        finished. In this process: `KeyboardInterrupt`, `SystemExit`; the trace is not finished.
    """
    supervision = supervision or supervision_of(prepared.loaded.scenario)
    if trace is None:
        return execute_unrecorded(
            prepared,
            progress=progress,
            engine=engine,
            pace=pace,
            supervision=supervision,
            keep=False,
        )[0]
    return execute_recorded(
        prepared,
        trace,
        progress=progress,
        engine=engine,
        pace=pace,
        fsync=fsync,
        supervision=supervision,
    )[0]


def execute_recorded(
    prepared: PreparedScenario,
    trace: Path | RowsInMemory,
    *,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    fsync: bool = False,
    supervision: Supervision,
    zero_state_run: bool = True,
    keep: bool = False,
    observers: Sequence[Observer] = (),
) -> tuple[Outcome, Outcome, Run]:
    """Run the scenario with a trace; return its outcome, that of `execute_unrecorded`, its rows.

    trace : its file, or what keeps the rows in memory. `observers` : take the rows as well.

    The second outcome is what the run without a trace has with the same `zero_state_run`, so that
    the figures of a run do not depend on whether its trace is kept.

    Raises
    ------
    As `execute_run`.
    """
    began = time.perf_counter()
    system, events = assembled_system(prepared)
    path = trace if isinstance(trace, Path) else None
    if path is not None:
        check_output(path)
    with (
        supervision.open(system, list(prepared.fmus.values()), engine) as supervisor,
        ExitStack() as living,
        _opened(trace, prepared, system, fsync=fsync) as writer,
    ):
        events_found = EventCollector(system.comm_schedule.start_ns)
        recorder = TraceRecorder(writer, system, events_found.take)
        made = _Runs(
            *(prepared, system, events, living, supervisor, progress or silent, engine, pace),
            call_limit=supervision.limits.call,
            collector=events_found,
        )
        try:
            run = made.run(recorder, *observers, keep=keep)
        except ComponentError as error:
            cause = Cause.of_error(error, None)
            refused = RunOutcome(
                status="failed", reason=error.text(), cause=cause, steps=0, simulated_s=0.0
            )
            recorder.conclude(0, refused.conclusion)
            writer.finish(refused.entries())
            raise
        made.run_from_zero_state(writer.flush)
        if supervisor is not None:
            recorder.run_ended = True
            living.close()
            supervisor.let_go()
        outcome = made.outcome(path, began)
        unrecorded = made.outcome(None, began, zero_state_run=zero_state_run)
        recorder.conclude(round(outcome.simulated_s * 1e9), outcome.conclusion)
        writer.finish(result_entries(outcome))
        outcome = replace(outcome, content_hash=writer.content_hash)
    outcome = replace(outcome, log_after_end=tuple(recorder.log_after_end))
    raise_if_interrupted(outcome, supervisor)
    return outcome, unrecorded, run


def _opened(
    trace: Path | RowsInMemory, prepared: PreparedScenario, system: System, *, fsync: bool
) -> TraceWriter | RowsInMemory:
    """Return what takes the rows of a run."""
    if isinstance(trace, RowsInMemory):
        return trace
    entries, attachments = run_metadata_of(prepared, system)
    return TraceWriter(trace, run=entries, attachments=attachments, fsync=fsync, content_hash=True)


def execute_unrecorded(
    prepared: PreparedScenario,
    *,
    zero_state_run: bool = True,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    pace: Pace | None = None,
    supervision: Supervision | None = None,
    supervisor: Supervisor | None = None,
    series: RunSeries | None = None,
    wanted: Wanted = ALL_FIGURES,
    keep: bool = True,
    observers: Sequence[Observer] = (),
) -> tuple[Outcome, Run]:
    """Run the scenario without a trace; return its outcome and its rows.

    zero_state_run : whether to make the zero-state run as well; without it no gain is measured,
        and envelope and limits are evaluated on this run alone.
    supervision : None: in this process, or by `supervisor`, which is open already.
    series : the run is one of these, in this process.
    wanted : the outcome has these figures and lacks others, beside status and assertions.
    keep : whether the run returned keeps its rows. `observers` : take them as they come.

    Raises
    ------
    InputError, ComponentError : see `execute_run`.
    """
    began = time.perf_counter()
    system, events = assembled_system(prepared, series)
    with ExitStack() as opened, ExitStack() as living:
        if supervision is not None:
            fmus = list(prepared.fmus.values())
            supervisor = opened.enter_context(supervision.open(system, fmus, engine))
        made = _Runs(
            *(prepared, system, events, living, supervisor, progress or silent, engine, pace),
            call_limit=None if supervision is None else supervision.limits.call,
            series=series,
            wanted=wanted,
        )
        run = made.run(*observers, keep=keep, zero_state_run=zero_state_run)
        made.run_from_zero_state()
        living.close()
        outcome = made.outcome(None, began)
    raise_if_interrupted(outcome, supervisor)
    return outcome, run


def assembled_system(
    prepared: PreparedScenario, series: RunSeries | None = None
) -> tuple[System, Sequence[Event | Machine]]:
    """Assemble the system; return it and its events."""
    loaded = prepared.loaded
    scenario = loaded.scenario
    system = _assembled(prepared, series)
    findings = Findings(loaded.origin)
    events = script_of(scenario, system, findings)
    bind_assertions(scenario, system, findings)
    return system, events


def _assembled(
    prepared: PreparedScenario, series: RunSeries | None, *, at_rest: bool = False
) -> System:
    """Assemble the system of the run or, `at_rest`, of the zero-state run."""
    purpose = "zero-state run" if at_rest else "run"
    rest, gain = prepared.at_rest if at_rest else {}, prepared.gain
    made = assemble(
        prepared.loaded.scenario,
        prepared.fmus,
        parameters={name: rest.get(name, {}) | gain.get(name, {}) for name in {*rest, *gain}},
        worst_case=prepared.worst_case,
        at_rest=at_rest,
        origin=prepared.loaded.origin,
        like=None if series is None else series.assembled.get(purpose),
    )
    if series is not None:
        series.assembled[purpose] = made
    return made.system


def loop_beside_design(prepared: PreparedScenario, system: System) -> LoopOfRun | None:
    """Return the loop of a run beside that of its design; None without a design."""
    design, problem, loop = prepared.design, prepared.problem, loop_of(prepared)
    if loop is None or design is None or problem is None:
        return None
    return loop_of_run(system, loop, design, problem, prepared.maps)


class _Runs:
    """The run of a scenario and its zero-state run, and what is measured of them.

    Parameters
    ----------
    living : ends the slaves when it is closed.
    call_limit : as in `run_system`.
    collector : takes the events of the run as soon as its rows are complete; None: they are
        counted only.
    """

    def __init__(
        self,
        prepared: PreparedScenario,
        system: System,
        events: Sequence[Event | Machine],
        living: ExitStack,
        supervisor: Supervisor | None,
        report_progress: Progress,
        engine: EngineName,
        pace: Pace | None,
        *,
        call_limit: float | None,
        collector: EventCollector | None = None,
        series: RunSeries | None = None,
        wanted: Wanted = ALL_FIGURES,
    ) -> None:
        self._call_limit, self._collector, self._series = call_limit, collector, series
        self._wanted = wanted
        self._prepared, self._system, self._events = prepared, system, events
        self._living, self._supervisor = living, supervisor
        self._report_progress, self._engine, self._pace = report_progress, engine, pace
        self._at_rest: System | None = None
        self._zero_state_run: Run | None = None
        self._zero_state: ZeroStateMeasures | None = None
        self._zero_state_figures: ZeroStateFigures | None = None
        self._laws_at_rest: LawMeasures | None = None
        self._laws: dict[str, MeasuredLaw] = {}
        judged = wanted.has(*OF_GUARANTEE)
        self._compared_loop = loop_beside_design(prepared, system) if judged else None

    def run(self, *observers: Observer, keep: bool, zero_state_run: bool = True) -> Run:
        """Make the run; one from the zero state is its own zero-state run.

        zero_state_run : whether a zero-state run is wanted.
        """
        measures = RunMeasures(
            self._prepared,
            self._system,
            self._collector,
            at_once=self._collector is not None,
            wanted=self._wanted,
        )
        # a recorder writes the events that the measures have found in the same rows
        watching: list[Observer] = [measures, *observers]
        if (laws := self._law_measures(self._compared_loop)) is not None:
            watching.append(laws)
        if zero_state_run and self._prepared.design is not None:
            at_rest = _assembled(self._prepared, self._series, at_rest=True)
            same = same_start(self._system, at_rest)
            # another run differs in start values alone
            self._laws_at_rest = laws if same else self._law_measures(self._compared_loop)
            noise = None if self._laws_at_rest is None else self._laws_at_rest.noise
            self._zero_state = ZeroStateMeasures(self._prepared, noise)
            if same:
                watching.append(self._zero_state)
            else:
                self._at_rest = at_rest
        completed = run_system(
            self._system,
            "run",
            self._report_progress,
            self._engine,
            *watching,
            living=self._living,
            events=self._events,
            pace=self._pace,
            supervisor=self._supervisor,
            keep=keep,
            call_limit=self._call_limit,
            series=self._series,
        )
        self._completed, self._figures = completed, measures.figures(completed.run)
        if laws is not None:
            self._laws["run"] = laws.measured(completed.run)
        return completed.run

    def _law_measures(self, compared: LoopOfRun | None) -> LawMeasures | None:
        """Return what measures the law of a run; None where nothing is claimed of it."""
        design, problem = self._prepared.design, self._prepared.problem
        if compared is None or design is None or problem is None:
            return None
        scenario = self._prepared.loaded.scenario
        return LawMeasures(
            *(compared.loop, compared.wiring, design, problem, changed_by(scenario)),
            altered=bool(scenario.events or scenario.modes),
        )

    def run_from_zero_state(self, flush: Callable[[], None] | None = None) -> None:
        """Make the zero-state run; none without a design, or after a failed or interrupted run.

        flush : writes what is recorded to disk, in case slaves must be ended first.
        """
        run = self._completed.run
        interrupted = run.cause is not None and run.cause.kind == "interrupted"
        if self._zero_state is None or run.status == "failed" or interrupted:
            return
        if self._at_rest is not None:
            run = self._run_at_rest(self._at_rest, self._zero_state, flush)
        self._zero_state_run = run
        self._zero_state_figures = self._zero_state.figures(run)

    def _run_at_rest(
        self, system: System, measures: Observer, flush: Callable[[], None] | None
    ) -> Run:
        if any(fmu.can_be_instantiated_only_once for fmu in self._prepared.fmus.values()):
            if flush is not None:
                flush()
            self._living.close()
        laws = self._laws_at_rest
        run = run_system(
            system,
            "zero-state run",
            self._report_progress,
            "auto",
            *filter(None, (measures, laws)),
            living=self._living,
            events=script_of(self._prepared.loaded.scenario, system, Findings()),
            supervisor=self._supervisor,
            keep=False,
            call_limit=self._call_limit,
            series=self._series,
        ).run
        if laws is not None:
            self._laws["zero-state run"] = laws.measured(run)
        return run

    def outcome(self, trace: Path | None, began: float, *, zero_state_run: bool = True) -> Outcome:
        """Return the outcome of both, or of the first; `began` : when, of `time.perf_counter`."""
        prepared, run = self._prepared, self._completed.run
        links = {name: dict(figures) for name, figures in run.statistics.items()}
        context = RunContext(
            prepared.loaded.scenario,
            prepared.problem,
            prepared.design,
            self._system,
            run,
            self._figures,
            self._zero_state_figures if zero_state_run else None,
            links,
            prepared.worst_case,
            altered=self._completed.altered,
            compared=self._compared_loop,
            laws=self._laws,
        )
        outcome = Outcome(
            scenario=prepared.loaded.name,
            title=prepared.loaded.scenario.title,
            status=status_of(context),
            reason=run.reason,
            trace=trace,
            content_hash=None,
            steps=max(run.count - 1, 0),
            simulated_s=run.end_ns / 1e9,
            wall_s=time.perf_counter() - began,
            final=final_values(self._figures),
            metrics=metrics_of(context, self._wanted),
            links=links,
            engine=run.engine,
            binaries=binary_origins(prepared.fmus, run.engine)
            if self._wanted.has("binaries")
            else {},
            pace=self._pace,
            assertions=self._figures.assertions,
            events=self._figures.events,
            design=prepared.source,
            cause=run.cause,
            supervised=None if self._supervisor is None else self._supervisor.method,
        )
        at_rest = self._zero_state_run if zero_state_run else None
        return _with_later_failure(outcome, at_rest, self._supervisor)


_DEATHS = ("crashed", "exited", "timed-out", "memory", "interrupted")


def _with_later_failure(
    outcome: Outcome, zero_state_run: Run | None, supervisor: Supervisor | None
) -> Outcome:
    """Return the outcome with what ended the child process beside or after a run that went well."""
    if outcome.cause is not None or supervisor is None:
        return outcome
    cause: Cause | None = None
    if zero_state_run is not None and zero_state_run.cause is not None:
        if zero_state_run.cause.kind in _DEATHS:
            cause, when, words = (
                zero_state_run.cause,
                "in the zero-state run",
                zero_state_run.reason,
            )
    elif supervisor.end_failure is not None:
        (cause, words), when = supervisor.end_failure, "after the run was complete"
    if cause is None:
        return outcome
    cause = replace(cause, detail=f"{when}: {cause.detail}")
    if not cause.failure:
        return replace(outcome, cause=cause)
    return replace(outcome, cause=cause, status="failed", reason=f"{when}: {words}")
