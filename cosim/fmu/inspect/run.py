"""Run an FMU for a moment in a process of its own, and judge what happened.

The binary is loaded there and nowhere else: a crash, an endless loop or a call of exit() ends
that process, and is a finding.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from cosim.fmu.inspect.archive import open_archive
from cosim.fmu.inspect.binaries import ROOT, platform_of
from cosim.fmu.inspect.declared_model import DeclaredModel, Interface, Variable, integer, number
from cosim.fmu.inspect.findings import Finding, Level, finding
from cosim.fmu.inspect.inspection import Inspection
from cosim.fmu.inspect.platforms import this_machine
from cosim.fmu.inspect.variables import identifier_findings

STEPS = 5
_PROBE = Path(__file__).with_name("probe.py")
_USUAL_STEP = 0.01
_MOST_OUTPUTS = 1000
_NUMERIC = frozenset(
    {"Real", "Integer", "Boolean", "Float32", "Float64"}
    | {f"{u}Int{bits}" for u in ("", "U") for bits in (8, 16, 32, 64)}
)
_AFTER_WORK = ("terminate", "free")
_LOG_LEVELS: dict[str, Level] = {"warning": "warning", "error": "warning", "fatal": "warning"}


def run_findings(inspection: Inspection, seconds: float) -> list[Finding]:
    """Run each kind of use of the FMU: set up, step, save and restore, reset, end.

    Parameters
    ----------
    inspection : what is known of the FMU; what cannot be unpacked is not run.
    seconds : time allowed for each kind of use.

    Raises
    ------
    InputError : the archive does not unpack.
    """
    model = inspection.model
    if model is None or not inspection.may_be_unpacked:
        return [finding("run-absent", inspection.path.name, "it cannot be unpacked or read")]
    findings: list[Finding] = []
    with (
        tempfile.TemporaryDirectory(prefix="cosim-") as scratch,
        open_archive(inspection.path) as archive,
    ):
        folder = Path(scratch) / "fmu"
        archive.unpack(folder)
        for interface in model.interfaces:
            if any(identifier_findings(interface.identifier, interface.kind)):
                what = "its modelIdentifier names no file of the FMU"
                findings.append(finding("run-absent", interface.kind, what))
                continue
            library = _library(folder, interface)
            if library is None:
                machine = this_machine()
                what = f"no binary for {machine.architecture} {machine.system}"
                findings.append(finding("run-absent", interface.kind, what))
                continue
            asked = request(model, interface, library)
            findings += _run(asked, folder, Path(scratch), seconds)
    return findings


def _library(folder: Path, interface: Interface) -> Path | None:
    """The binary for this machine."""
    machine = this_machine()
    for place in sorted((folder / ROOT).glob("*")):
        library = place / (interface.identifier + machine.suffix)
        if platform_of(place.name) == machine and library.is_file():
            return library
    return None


def request(model: DeclaredModel, interface: Interface, library: Path) -> dict[str, Any]:
    """What the probe is asked to do."""
    start, stop, step = (
        number(model.experiment.get(key)) for key in ("startTime", "stopTime", "stepSize")
    )
    begin = start or 0.0
    span = stop - begin if stop is not None and stop > begin else 1.0
    h = step if step is not None and 0.0 < step <= span else min(_USUAL_STEP, span)
    outputs: dict[str, list[list[int]]] = defaultdict(list)
    for v in model.variables:
        room = sum(map(len, outputs.values())) < _MOST_OUTPUTS
        if v.causality == "output" and _readable(v) and room:
            outputs[_called(v, model)].append([v.reference or 0, _size(v, model)])
    state = "canGetAndSetFMUState" if model.major == 3 else "canGetAndSetFMUstate"
    serialize = "canSerializeFMUState" if model.major == 3 else "canSerializeFMUstate"
    derivatives = [u.target for u in model.structure if u.role == "derivative"]
    variables_by_target = model.variables_by_target()
    states = sum(
        _size(variables_by_target[d], model)
        for d in derivatives
        if d is not None and d in variables_by_target
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
        # twice the steps are taken where a state is saved, and FMUs refuse to pass their end
        "stop": begin + max(span, 4 * STEPS * h),
        "step": h,
        "steps": STEPS,
        "outputs": outputs,
        "starts": _starts(model),
        "state": interface.is_true(state),
        "serialize": interface.is_true(state) and interface.is_true(serialize),
        "reset": model.major > 1,
        "states": states,
    }


def _readable(v: Variable) -> bool:
    return (v.type in _NUMERIC or v.type == "Enumeration") and not v.clocks


def _called(v: Variable, model: DeclaredModel) -> str:
    """The type in the names of the functions that read it."""
    if v.type == "Enumeration":
        return "Int64" if model.major == 3 else "Integer"
    return v.type


def _size(v: Variable, model: DeclaredModel) -> int:
    """Number of elements at the start."""
    sizes = {w.reference: integer(w.start) for w in model.variables} if v.dimensions else {}
    size = 1
    for extent, reference in v.dimensions:
        size *= (extent if reference is None else sizes.get(reference)) or 1
    return size


def _starts(model: DeclaredModel) -> list[list[Any]]:
    """Scalar parameters with a start: name, type, value reference, start."""
    found: list[list[Any]] = []
    if model.major == 1:
        return found  # nothing may be read before the initialization is over
    for v in model.variables:
        value = number(v.start)
        if "arameter" in v.causality and _readable(v) and not v.dimensions and value is not None:
            found.append([v.name, _called(v, model), v.reference or 0, value])
    return found[:_MOST_OUTPUTS]


def _run(asked: dict[str, Any], folder: Path, scratch: Path, seconds: float) -> list[Finding]:
    kind = asked["kind"]
    slug = kind.replace(" ", "-")
    question, events = scratch / f"{slug}.json", scratch / f"{slug}.events"
    question.write_text(json.dumps(asked), "utf-8")
    command = [sys.executable, "-P", str(_PROBE), str(folder), str(question), str(events)]
    ended = _wait(command, folder, seconds)
    happened = _events(events)
    return list(_judge(kind, happened, ended, seconds))


def _wait(command: list[str], folder: Path, seconds: float) -> int | None:
    """The exit code, or None if the time was over; the process and its children are gone."""
    process = subprocess.Popen(  # noqa: S603 - this interpreter, our own file
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if hasattr(os, "killpg"):
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.wait()


def _events(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    lines = path.read_text("utf-8", "replace").splitlines()
    events = []
    for line in lines:
        try:
            event = json.loads(line)
        except ValueError:
            continue  # cut short by the end of the process
        if isinstance(event, dict):
            events.append(event)
    return events


def _judge(
    kind: str, events: list[dict[str, Any]], ended: int | None, seconds: float
) -> Iterator[Finding]:
    stage = next((e["stage"] for e in reversed(events) if set(e) == {"stage"}), "load")
    finished = any("end" in e for e in events)
    where = f"{kind}: {stage}"
    if ended is None:
        what = f"no answer within {seconds:g} s"
        yield finding("run-timeout", where, what)
    elif not finished:
        what = f"the process ended by {_cause(ended)}"
        yield finding("run-end" if stage in _AFTER_WORK else "run-crash", where, what)
    elif ended != 0:
        yield finding("run-end", f"{kind}: unload", f"the process ended by {_cause(ended)}")
    for event in events:
        yield from _event(kind, event)
    if finished and stage == _AFTER_WORK[-1]:
        did = ", ".join(e["stage"] for e in events if set(e) == {"stage"})
        steps = next((e for e in events if "steps" in e), None)
        count = f"; {steps['steps']} steps to t = {steps['t']:g} s" if steps else ""
        yield finding("run-done", kind, f"{did}{count}")
    if kind == "scheduled execution":
        yield finding("run-kind", kind, "no model partition was activated")


def _event(kind: str, event: dict[str, Any]) -> Iterator[Finding]:
    where = f"{kind}: {event.get('stage', 'run')}"
    if "refused" in event:
        yield finding("run-refused", where, event["refused"])
    elif "broken" in event:
        loading = event["stage"] == "load"
        yield finding("run-load" if loading else "run-broken", where, event["broken"])
    elif "log" in event:
        level = _LOG_LEVELS.get(event["log"], "note")
        yield finding("run-log", where, f"{event['log']}: {event['text']}", level=level)
    elif "differs" in event:
        code = {"state": "run-state", "serialized": "run-serialized"}
        what = f"the outputs after {event['differs']} are not those before"
        yield finding(code.get(event["differs"], "run-reset"), kind, what)
    elif "start" in event:
        what = f"{event['start']} is {event['got']}, described as {event['described']:g}"
        yield finding("run-start", f"{kind}: start values", what)
    elif event.get("finite") is False:
        yield finding("run-not-finite", f"{kind}: step", "some outputs are not finite numbers")


def _cause(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"
