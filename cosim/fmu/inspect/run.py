"""Run an FMU briefly in a process of its own and report what happened.

Only that process loads the binary, so that a crash, an endless loop or a call of exit() ends it
alone and becomes a finding.
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
from cosim.fmu.inspect.binaries import ROOT, missing_binary, platform_of
from cosim.fmu.inspect.declared_model import DeclaredModel, Interface, Variable, integer, number
from cosim.fmu.inspect.definitions import identifier_findings
from cosim.fmu.inspect.findings import Finding, Level, finding
from cosim.fmu.inspect.inspection import Inspection
from cosim.fmu.inspect.platforms import this_machine
from cosim.fmu.port import TYPE_MAPPINGS

STEPS = 5
_PROBE = Path(__file__).with_name("probe.py")
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
    with tempfile.TemporaryDirectory(prefix="cosim-") as scratch:
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
            findings += _run(asked, folder, Path(scratch), seconds)
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


def _getter_type(v: Variable, model: DeclaredModel) -> str | None:
    """Return the type in the name of the function that reads a number; None if none does."""
    types = TYPE_MAPPINGS["3.0" if model.major == 3 else "2.0"]  # FMI 1 has those of FMI 2
    found = types.get(v.type)
    readable = found is not None and found.kind in ("float", "int", "bool") and not v.clocks
    return found.getter_type if found is not None and readable else None


def _size(v: Variable, model: DeclaredModel) -> int:
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
    """Return the exit code, or None after the time limit; end the process and its children."""
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
            continue  # cut off by the end of the process
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
        yield finding("run-timeout", where, f"no answer within {seconds:g} s")
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
