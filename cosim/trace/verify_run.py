"""Check the content of a run's trace: complete, and consistent as a run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode

from cosim.core import CosimError, InputError
from cosim.trace import layout
from cosim.trace.check_results import Check, check_result, with_missing
from cosim.trace.pieces import McapFile, attachment_of, metadata_of
from cosim.trace.reader import Table, Trace
from cosim.trace.records import Cursor
from cosim.trace.scan import Scan
from cosim.trace.traffic import link_names
from cosim.trace.verify_links import Link, checks_of_links

_HASHED = {
    "scenario.sha256": layout.SCENARIO_ATTACHMENT,
    "design.sha256": layout.DESIGN_ATTACHMENT,
}


def checks_of_run(file: McapFile, found: Scan, path: Path, fmus: Path | None) -> list[Check] | None:
    """Make the checks of a run; None if the file has no `cosim.run`.

    `InputError` if there is no folder `fmus`.
    """
    metadata = [metadata_of(file.content(p)) for p in found.pieces if p.opcode == Opcode.METADATA]
    run = next((entries for name, entries in metadata if name == layout.RUN), None)
    if run is None:
        return None
    records = [file.content(p) for p in found.pieces if p.opcode == Opcode.ATTACHMENT]
    attached = {one.name: one.data for one in map(attachment_of, records)}
    cut = found.ended is None
    checks = [_beginning(file, found, run, attached), *_fmus(run, attached, fmus, cut=cut)]
    result = next((entries for name, entries in metadata if name == layout.RESULT), None)
    checks.append(_result(metadata, result))
    checks.append(_certificate(run, attached, cut=cut))
    try:
        trace = Trace(path, incomplete=True)
        tables = trace.read_all()
    except CosimError as error:
        return [*checks, Check("rows", "failed", error.text().replace("\n", ";"))]
    checks.append(_order(trace))
    checks.append(_steps(tables, run, result))
    checks += checks_of_links(_links(trace, tables, run, result), tables, whole=result is not None)
    return checks


def _beginning(
    file: McapFile, found: Scan, run: Mapping[str, str], attached: Mapping[str, bytes]
) -> Check:
    """Check that cosim.run comes first, and that attached files have the hashes it names."""
    problems: list[str] = []
    first = next(p for p in found.pieces if p.opcode != Opcode.HEADER)
    if first.opcode != Opcode.METADATA or Cursor(file.content(first)).text() != layout.RUN:
        problems.append("cosim.run is not the first record")
    named = {name: run[key] for key, name in _HASHED.items() if key in run}
    missing = [f"{name} is not attached" for name in named if name not in attached]
    problems += [
        f"{name} is not the file of the SHA-256 that cosim.run names"
        for name, expected in named.items()
        if name in attached and hashlib.sha256(attached[name]).hexdigest() != expected
    ]
    check = check_result("run", problems, f"cosim.run first; {len(named)} attached files as named")
    return with_missing(check, missing, cut=found.ended is None)


def _fmus(
    run: Mapping[str, str], attached: Mapping[str, bytes], folder: Path | None, *, cut: bool
) -> Iterator[Check]:
    suffix = ".sha256"
    hashes = {
        key.removeprefix("fmu.").removesuffix(suffix): value
        for key, value in run.items()
        if key.startswith("fmu.") and key.endswith(suffix)
    }
    problems = [
        f"{name}: no SHA-256 but {value!r}"
        for name, value in hashes.items()
        if len(value) != 64 or set(value) - set("0123456789abcdef")
    ]
    names = [k.removeprefix("fmu.") for k in run if k.startswith("fmu.") and not k.endswith(suffix)]
    problems += [f"{name}: no SHA-256" for name in names if name not in hashes]
    missing = [
        f"the model description of {name} is not attached"
        for name in hashes
        if f"{name}.modelDescription.xml" not in attached
    ]
    if not hashes and not problems:
        yield Check("FMUs", "not checked", "cosim.run names none")
        return
    check = check_result("FMUs", problems, f"{', '.join(hashes)}: named by SHA-256, described")
    yield with_missing(check, missing, cut=cut)
    if folder is None:
        return
    if not folder.is_dir():
        raise InputError("there is no such folder", where="--fmus", got=str(folder))
    there = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in sorted(folder.rglob("*.fmu"))
        if path.is_file()
    }
    absent = [f"{n}: no file of SHA-256 {h}" for n, h in hashes.items() if h not in there]
    found = ", ".join(f"{n}: {there[h]}" for n, h in hashes.items() if h in there)
    yield check_result("FMU files", absent, found)


def _certificate(run: Mapping[str, str], attached: Mapping[str, bytes], *, cut: bool) -> Check:
    certificate = layout.certificate_of(run)
    if certificate is None:
        return Check("certificate", "not checked", "cosim.run names none")
    data = attached.get(layout.CERTIFICATE_ATTACHMENT)
    if data is None:
        missing = [f"{layout.CERTIFICATE_ATTACHMENT} is not attached"]
        return with_missing(check_result("certificate", [], ""), missing, cut=cut)
    if hashlib.sha256(data).hexdigest() != certificate["sha256"]:
        other = "it is not the file of the SHA-256 that cosim.run names"
        return Check("certificate", "failed", other)
    try:
        claim = json.loads(data)["claim"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return Check("certificate", "failed", "it makes no claim")
    if claim != certificate["claim"]:
        return Check("certificate", "failed", "it claims something else than cosim.run says")
    return Check("certificate", "ok", "the file named; its proof: cosim certificate check")


def _result(metadata: list[tuple[str, dict[str, str]]], result: Mapping[str, str] | None) -> Check:
    if result is None:
        return Check("result", "incomplete", "no cosim.result: the run did not finish")
    names = [name for name, _ in metadata]
    if names.count(layout.RESULT) > 1 or names.count(layout.RUN) > 1:
        return Check("result", "failed", "more than one cosim.run or cosim.result")
    if names[-1] != layout.RESULT:
        return Check("result", "failed", f"{names[-1]} comes after cosim.result")
    return Check("result", "ok", f"cosim.result last; status {result.get('status', 'not named')}")


def _order(trace: Trace) -> Check:
    last, count = 0, 0
    for channel, _, log, publish, _ in trace.messages():
        count += 1
        if log < last:
            return Check("order", "failed", f"{channel.topic} at {log} ns comes after {last} ns")
        if publish > log:
            what = f"{channel.topic}: delivered at {log} ns, sent at {publish} ns"
            return Check("order", "failed", what)
        last = log
    return Check("order", "ok", f"{count} messages in order of delivery, none before it was sent")


def _steps(
    tables: Mapping[str, Table], run: Mapping[str, str], result: Mapping[str, str] | None
) -> Check:
    """Check that every component has a row at each communication point, or each of its own."""
    topics = {
        topic: table.log_time_ns
        for topic, table in tables.items()
        if topic.endswith(("/output", "/input")) and len(table)
    }
    if not topics:
        return Check("rows", "not checked", "no component has rows")
    problems = [
        f"{topic}: two rows at one instant"
        for topic, t in topics.items()
        if (np.diff(t) <= 0).any()
    ]
    most = max(times.size for times in topics.values())
    status = "" if result is None else result.get("status", "")
    if result is not None and status != "failed":
        steps = result.get("steps", "")
        points = int(steps) + 1 if steps.isdecimal() else most
        for topic, times in topics.items():
            # a component with its own step has rows at its own points, and at the end
            own = np.unique(np.diff(times[:-1])).size <= 1
            if times.size > points or (times.size < points and not own):
                problems.append(f"{topic}: {times.size} rows, {points} communication points")
    if status in ("finished", "limit_cycle") and "end_ns" in run:
        late = [t for t, times in topics.items() if str(int(times[-1])) != run["end_ns"]]
        problems += [f"{topic} does not reach the end, {run['end_ns']} ns" for topic in late]
    return check_result(
        "rows", problems, f"{len(topics)} topics, up to {most} communication points"
    )


def _links(
    trace: Trace,
    tables: Mapping[str, Table],
    run: Mapping[str, str],
    result: Mapping[str, str] | None,
) -> list[Link]:
    links = []
    for name in link_names(trace):
        topic, prefix = layout.link_topic(name), f"link.{name}."
        if topic not in tables:
            continue
        dropped = tables.get(layout.dropped_topic(name))
        declared = _declared(run.get(f"link.{name}"))
        declared["order"] = trace.topics[topic].metadata.get("order")
        entries = (result or {}).items()
        figures = {k.removeprefix(prefix): v for k, v in entries if k.startswith(prefix)}
        links.append(Link(name, tables[topic], dropped, declared, figures))
    return links


def _declared(text: str | None) -> dict[str, Any]:
    try:
        declared = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return {}
    return declared if isinstance(declared, dict) else {}
