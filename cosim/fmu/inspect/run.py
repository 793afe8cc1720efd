"""Run an FMU briefly in a process of its own and report what happened.

Only that process loads the binary, so that a crash, an endless loop or a call of exit() ends it
alone and becomes a finding.
"""

from __future__ import annotations

import signal
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cosim.core import FrameError, Output, Waiting, Worker
from cosim.fmu.inspect.archive import open_archive
from cosim.fmu.inspect.binaries import ROOT, missing_binary, platform_of
from cosim.fmu.inspect.declared_model import (
    DeclaredModel,
    DeclaredVariable,
    Interface,
    integer,
    number,
)
from cosim.fmu.inspect.definitions import identifier_findings
from cosim.fmu.inspect.findings import Finding, finding
from cosim.fmu.inspect.inspection import Inspection
from cosim.fmu.inspect.platforms import this_machine
from cosim.fmu.inspect.probe import Event
from cosim.fmu.inspect.rules import Level
from cosim.fmu.port import TYPE_MAPPINGS
from cosim.fmu.unpacking import own_folder

STEPS = 5
_PROBE = "cosim.fmu.inspect.probe:main"
_TICK_S = 0.05
_MOST_EVENTS = 10_000
_USUAL_STEP = 0.01
_MOST_OUTPUTS = 1000
_AFTER_WORK = ("terminate", "free")
_LOG_LEVELS: dict[str, Level] = {"warning": "warning", "error": "warning", "fatal": "warning"}


def run_findings(inspection: Inspection, seconds: float) -> list[Finding]:
    """Run each kind of use of the FMU: set up, step, save and restore, reset, end.

    Parameters
    ----------
    inspection : of the FMU; one that cannot be unpacked is not run.
    seconds : time allowed for each kind of use.

    Raises
    ------
    InputError : the archive does not unpack, or has changed since it was inspected.
    """
    model = inspection.model
    if model is None or not inspection.may_be_unpacked:
        return [finding("run-absent", inspection.path.name, "it cannot be unpacked or read")]
    findings: list[Finding] = []
    archive = open_archive(inspection.path, inspection.sha256)
    with tempfile.TemporaryDirectory(prefix="check-", dir=own_folder()) as scratch:
        folder = Path(scratch) / "fmu"
        archive.unpack(folder)
        for interface in model.interfaces:
            if any(identifier_findings(interface.identifier, interface.kind)):
                what = "its modelIdentifier does not name a file of the FMU"
                findings.append(finding("run-absent", interface.kind, what))
                continue
            library = _library(folder, interface)
            if library is None:
                findings.append(finding("run-absent", interface.kind, missing_binary()))
                continue
            asked = request(model, interface, library)
            findings += _run(asked, folder, seconds)
    return findings


def _library(folder: Path, interface: Interface) -> Path | None:
    """Return the binary for this machine."""
    machine = this_machine()
    for place in sorted((folder / ROOT).glob("*")):
        library = place / (interface.identifier + machine.suffix)
        if platform_of(place.name) == machine and library.is_file():
            return library
    return None


def request(model: DeclaredModel, interface: Interface, library: Path) -> dict[str, Any]:
    """Return what the probe is to do, as JSON values."""
    start, stop, step = (
        number(model.experiment.get(key)) for key in ("startTime", "stopTime", "stepSize")
    )
    begin = start or 0.0
    span = stop - begin if stop is not None and stop > begin else 1.0
    h = step if step is not None and 0.0 < step <= span else min(_USUAL_STEP, span)
    outputs: dict[str, list[list[int]]] = defaultdict(list)
    for v in model.variables:
        getter_type = _getter_type(v, model)
        room = sum(map(len, outputs.values())) < _MOST_OUTPUTS
        if v.causality == "output" and getter_type is not None and room:
            outputs[getter_type].append([v.reference or 0, _size(v, model)])
    state = "FMUState" if model.major == 3 else "FMUstate"
    can_restore = interface.is_true(f"canGetAndSet{state}")
    by_target = model.variables_by_target()
    derivatives = (u.target for u in model.structure if u.role == "derivative")
    states = sum(
        _size(by_target[d], model) for d in derivatives if d is not None and d in by_target
    )
    if model.major == 1:
        states = integer(model.attributes.get("numberOfContinuousStates")) or 0
    return {
        "major": model.major,
        "kind": interface.kind,
        "token": model.token or "",
        "identifier": interface.identifier,
        "library": str(library),
        "start": begin,
        # up to twice the steps are taken where a state is saved; FMUs refuse to pass their end
        "stop": begin + max(span, 4 * STEPS * h),
        "step": h,
        "steps": STEPS,
        "outputs": outputs,
        "starts": _starts(model),
        "state": can_restore,
        "serialize": can_restore and interface.is_true(f"canSerialize{state}"),
        "reset": model.major > 1,
        "states": states,
    }


def _getter_type(v: DeclaredVariable, model: DeclaredModel) -> str | None:
    """Return the type in the name of the function that reads a number; None if none does."""
    types = TYPE_MAPPINGS["3.0" if model.major == 3 else "2.0"]  # FMI 1 has those of FMI 2
    found = types.get(v.type)
    readable = found is not None and found.kind in ("float", "int", "bool") and not v.clocks
    return found.getter_type if found is not None and readable else None


def _size(v: DeclaredVariable, model: DeclaredModel) -> int:
    """Return the number of elements at the start."""
    sizes = {w.reference: integer(w.start) for w in model.variables} if v.dimensions else {}
    size = 1
    for extent, reference in v.dimensions:
        size *= (extent if reference is None else sizes.get(reference)) or 1
    return size


def _starts(model: DeclaredModel) -> list[list[Any]]:
    """Return the scalar parameters with a start: name, type, value reference, start."""
    found: list[list[Any]] = []
    if model.major == 1:
        return found  # nothing may be read before the initialization is over
    for v in model.variables:
        value, getter_type = number(v.start), _getter_type(v, model)
        known = value is not None and getter_type is not None
        if "arameter" in v.causality and not v.dimensions and known:
            found.append([v.name, getter_type, v.reference or 0, value])
    return found[:_MOST_OUTPUTS]


def _run(asked: dict[str, Any], folder: Path, seconds: float) -> list[Finding]:
    kind = asked["kind"]
    worker = Worker(_PROBE, (asked, str(folder)), received=Event)
    try:
        events, ended = _followed(worker, seconds)
    finally:
        worker.close(0.0)
    return list(_judge(kind, events, ended, seconds))


def _followed(worker: Worker, seconds: float) -> tuple[list[Event], int | str | None]:
    """Return the events of a run, and how it ended: exit code, words, or None after its time."""
    events: list[Event] = []
    outputs = [Output(descriptor, "", "") for descriptor in (worker.stdout, worker.stderr)]
    until = time.monotonic() + seconds
    ended: int | str | None = None
    with Waiting([worker], outputs) as waiting:
        while ended is None and time.monotonic() < until:
            waiting.wait(_TICK_S)
            ended = worker.exit_status()
            try:
                while (event := worker.frames.take()) is not None and time.monotonic() < until:
                    if len(events) < _MOST_EVENTS:
                        events.append(event)
            except EOFError:
                if ended is None:
                    ended = worker.ended_within(_TICK_S)
            except (FrameError, OSError):
                ended = "what is no message of this program"
    return events, ended


def _judge(
    kind: str, events: list[Event], ended: int | str | None, seconds: float
) -> Iterator[Finding]:
    stages = [event.stage for event in events if event.begins_stage and event.stage is not None]
    stage = stages[-1] if stages else "load"
    finished = any(event.end for event in events)
    where = f"{kind}: {stage}"
    if ended is None:
        yield finding("run-timeout", where, f"no answer within {seconds:g} s")
    elif not finished:
        what = f"the process ended by {_cause(ended)}"
        yield finding("run-end" if stage in _AFTER_WORK else "run-crash", where, what)
    elif ended != 0:
        yield finding("run-end", f"{kind}: unload", f"the process ended by {_cause(ended)}")
    for event in events:
        yield from _event(kind, event)
    if finished and stage == _AFTER_WORK[-1]:
        steps = next((event for event in events if event.steps is not None), None)
        count = f"; {steps.steps} steps to t = {steps.t:g} s" if steps else ""
        yield finding("run-done", kind, f"{', '.join(stages)}{count}")
    if kind == "scheduled execution":
        yield finding("run-kind", kind, "no model partition was activated")


def _event(kind: str, event: Event) -> Iterator[Finding]:
    where = f"{kind}: {event.stage or 'run'}"
    if event.refused is not None:
        yield finding("run-refused", where, event.refused)
    elif event.broken is not None:
        loading = event.stage == "load"
        yield finding("run-load" if loading else "run-broken", where, event.broken)
    elif event.log is not None:
        level = _LOG_LEVELS.get(event.log, "note")
        yield finding("run-log", where, f"{event.log}: {event.text}", level=level)
    elif event.differs is not None:
        code = {"state": "run-state", "serialized": "run-serialized"}
        what = f"the outputs after {event.differs} are not those before"
        yield finding(code.get(event.differs, "run-reset"), kind, what)
    elif event.start is not None:
        what = f"{event.start} is {event.got}, described as {event.described:g}"
        yield finding("run-start", f"{kind}: start values", what)
    elif not event.finite:
        yield finding("run-not-finite", f"{kind}: step", "some outputs are not finite numbers")


def _cause(code: int | str) -> str:
    if isinstance(code, str):
        return code
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"
