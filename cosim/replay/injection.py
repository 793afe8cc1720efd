"""Injection: feed recorded signals into one FMU, open loop.

For instance, to try a new controller on recorded data. The inputs follow the recorded rows at
their own instants, so an FMU that gets its recorded inputs again gives its recorded outputs,
bit for bit. The outputs go to a new trace of the same layout, which names its sources.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import AnyPath, InputError, Progress, silent
from cosim.fmu import FmuDescription, describe_fmu
from cosim.fmu.export import spec_of
from cosim.master import (
    CommunicationSchedule,
    Component,
    Endpoint,
    System,
    TraceRecorder,
    identifier,
)
from cosim.replay.injection_request import InjectionRequest, provenance, start_values
from cosim.replay.input_values import InputValues, Link, resampled_inputs
from cosim.replay.mapping import Source, as_delivered, as_sent, mapped, role_of, unmapped_inputs
from cosim.replay.trace_attachments import scenario_in
from cosim.scenario import FmuCache, LoadedScenario, link_of, run_system
from cosim.trace import Attachment, Diff, RunOutcome, Table, Trace, TraceWriter, diff
from cosim.trace.rows import SCENARIO_ATTACHMENT, output_topic

_DIVERGENCE = 1e300


@dataclass(frozen=True)
class InjectionResult:
    """The result of an injection.

    Attributes
    ----------
    name : of the component in the new trace.
    role : the recorded component that the FMU stands for.
    sources : of each input; `unmapped_inputs` : inputs that kept their start values.
    unused : recorded inputs of `role` that were not used.
    parameters : set before the start; `not_set` : recorded ones that the FMU does not have.
    status : finished, diverged or failed; `reason` why.
    compared : the outputs against the recorded ones, if requested; `identical` : bit for bit.
    log_after_end : as in `Outcome`.
    """

    trace: Path
    content_hash: str
    fmu: FmuDescription
    name: str
    role: str | None
    sources: Mapping[str, Source]
    unmapped_inputs: Sequence[str]
    unused: Sequence[str]
    parameters: Mapping[str, Any]
    not_set: Sequence[str]
    points: int
    end_s: float
    shift_s: float
    status: str
    reason: str | None
    compared: Diff | None
    identical: bool | None
    log_after_end: tuple[dict[str, str], ...]


def inject(
    path: AnyPath,
    into: Any,
    output: AnyPath,
    request: InjectionRequest | None = None,
    *,
    progress: Progress | None = None,
) -> InjectionResult:
    """Feed recorded signals into an FMU and record its outputs.

        >>> from cosim import DelaySystem, Scenario, inject, run
        >>> tank = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> two = Scenario(step=0.1, until=2).add("upper", tank, initial=[1.0]).add("lower", tank)
        >>> flight = run(two.connect("upper.x", "lower.u"), "flight.mcap")
        >>> fed = inject("flight.mcap", tank.with_(A=[[-0.7]]), "other.mcap")
        >>> fed.status, fed.role, list(fed.sources), fed.points
        ('finished', 'lower', ['u[1]'], 21)

    Parameters
    ----------
    path : the trace with the signals, or any MCAP file with protobuf or JSON topics.
    into : the path of an FMU, its description, or what `cosim.pack` takes: a design, a system.
    output : the new trace.
    request : which signals are fed and compared; by default every input of the same name.

    Raises
    ------
    InputError : no signal for any input, or an unknown name or link.
    ComponentError : the FMU cannot be loaded or initialised.
    """
    request = request or InjectionRequest()
    output, fmu, trace = Path(output), _described(into), Trace(Path(path))
    scenario = scenario_in(trace, Path.cwd()) if SCENARIO_ATTACHMENT in trace.attachments else None
    if request.compare is not None and output_topic(request.compare) not in trace.topics:
        recorded = [t.split("/")[1] for t in trace.topics if t.endswith("/output")]
        raise InputError.unknown("recorded component", request.compare, recorded, where="`compare`")
    role = role_of(trace, fmu, request.signal_mapping.role)
    sources = mapped(trace, fmu, request.signal_mapping, role)
    direct, linked = _routed(trace, sources, request, scenario)
    link = _link(request.link, scenario, trace) if request.side == "sent" else None
    parameters, not_set = start_values(trace, fmu, request, role, scenario)
    starts = {n: float(parameters.get(n, fmu.ports[n].start or 0.0)) for n in sources}
    input_values = resampled_inputs(trace, direct, linked, link, starts, request.step_ns)
    name = request.compare or role or identifier(fmu.model.attributes.get("modelName", ""))
    system = _system(name, fmu, parameters, input_values)
    if request.compare is not None and input_values.shift_ns:
        raise InputError(
            "the recording does not begin at t = 0: its outputs are not those of this run",
            where="`compare`",
            got=f"first row at {input_values.shift_ns / 1e9:g} s",
        )
    entries = provenance(
        trace, fmu, name, request, link, {**direct, **linked}, parameters, input_values
    )
    xml = Attachment(f"{name}.modelDescription.xml", "text/xml", fmu.xml)
    with (
        ExitStack() as living,
        TraceWriter(output, run=entries, attachments=[xml], content_hash=True) as writer,
    ):
        recorder, report_progress = TraceRecorder(writer, system), progress or silent
        run = run_system(system, "injecting", report_progress, "auto", recorder, living=living).run
        outcome = RunOutcome(
            status=run.status,
            reason=run.reason,
            cause=run.cause,
            steps=max(run.points_ns.size - 1, 0),
            simulated_s=run.end_ns / 1e9,
        )
        recorder.conclude(run.end_ns, outcome.conclusion)
        writer.finish(outcome.entries(engine=f"{run.engine.name}: {run.engine.reason}"))
    compared, identical = None, None
    if request.compare is not None:
        topic = output_topic(name)
        compared = diff(trace.path, output, request.tolerances, topics=[topic])
        identical = _same_bits(trace.read(topic), Trace(output).read(topic))
    received = [] if role is None else trace.topics[f"/{role}/input"].signals
    return InjectionResult(
        trace=output,
        content_hash=writer.content_hash,
        fmu=fmu,
        name=name,
        role=role,
        sources={**direct, **linked},
        unmapped_inputs=unmapped_inputs(fmu, sources),
        unused=[s.name for s in received if s.name not in sources],
        parameters=parameters,
        not_set=not_set,
        points=int(run.points_ns.size),
        end_s=float(run.points_ns[-1]) / 1e9 if run.points_ns.size else 0.0,
        shift_s=input_values.shift_ns / 1e9,
        status=run.status,
        reason=run.reason,
        compared=compared,
        identical=identical,
        log_after_end=tuple(recorder.log_after_end),
    )


def _same_bits(a: Table, b: Table) -> bool:
    return (
        list(a.columns) == list(b.columns)
        and np.array_equal(a.log_time_ns, b.log_time_ns)
        and all(a[name].tobytes() == b[name].tobytes() for name in a.columns)
    )


def _described(into: Any) -> FmuDescription:
    """Return the description of an FMU; one that is packed is kept in the user's cache."""
    if isinstance(into, FmuDescription):
        return into
    if isinstance(into, str | PathLike):
        return describe_fmu(Path(into))
    return FmuCache(Path("fmus")).made(spec_of(into, "injected"), "into")


def _routed(
    trace: Trace,
    sources: Mapping[str, Source],
    request: InjectionRequest,
    scenario: LoadedScenario | None,
) -> tuple[dict[str, Source], dict[str, Source]]:
    """Return the sources that are fed directly, and those that go over the new link."""
    if request.side == "delivered":
        if request.link is not None:
            raise InputError(
                "delivered signals have passed their link already",
                where="`link`",
                hint="`as` sent",
            )
        return {name: as_delivered(trace, source) for name, source in sources.items()}, {}
    direct, linked = {}, {}
    for name, source in sources.items():
        origin, sent = as_sent(trace, source, None if scenario is None else scenario.scenario)
        if sent and request.link is not None:
            linked[name] = origin
        else:
            direct[name] = origin
    return direct, linked


def _link(link: Link | str | None, scenario: LoadedScenario | None, trace: Trace) -> Link | None:
    if not isinstance(link, str):
        return link
    parts = {} if scenario is None else scenario.scenario.links
    if scenario is None or link not in parts:
        raise InputError.unknown("recorded link", link, parts, where=f"`link`, {trace.path}")
    return link_of(link, parts[link], scenario.scenario.run.seed)


def _system(
    name: str, fmu: FmuDescription, parameters: Mapping[str, Any], input_values: InputValues
) -> System:
    steps = np.unique(np.diff(input_values.points_ns))
    if steps.size > 1 and not fmu.variable_step:
        raise InputError(
            "this FMU needs steps of one size, and the recorded steps differ",
            where=str(fmu.path),
            expected="canHandleVariableCommunicationStepSize, or a step that divides the end",
            got=f"steps from {steps[0] / 1e9:g} s to {steps[-1] / 1e9:g} s",
            hint="`step` SECONDS",
        )
    return System(
        components={name: Component(fmu, dict(parameters))},
        connections=[],
        links={},
        driven={Endpoint(name, signal): values for signal, values in input_values.values.items()},
        comm_schedule=CommunicationSchedule.of_points(input_values.points_ns),
        divergence=_DIVERGENCE,
    )
