"""Check the content of a run's trace: complete, and consistent as a run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cosim.core import CosimError, InputError
from cosim.trace.checks.of_file import FileChecks
from cosim.trace.checks.of_links import Link, Sender, checks_of_links, sender_of
from cosim.trace.checks.results import CheckResult, check_result, with_missing
from cosim.trace.file.walk import Walk
from cosim.trace.reader import Table, Trace
from cosim.trace.recovered import Recovered
from cosim.trace.rows import layout

_HASHED = {
    "scenario.sha256": layout.SCENARIO_ATTACHMENT,
    "design.sha256": layout.DESIGN_ATTACHMENT,
}


def checks_of_run(
    walk: Walk, found: FileChecks, path: Path, fmus: Path | None
) -> list[CheckResult] | None:
    """Make the checks of a run; None if the file has no `cosim.run`.

    `InputError` if there is no folder `fmus`.
    """
    run = next((entries for name, entries in found.metadata if name == layout.RUN), None)
    if run is None:
        return None
    cut = walk.ended is None
    checks = [_beginning(found, run, cut=cut), *_fmus(run, found.attached, fmus, cut=cut)]
    result = next((entries for name, entries in found.metadata if name == layout.RESULT), None)
    checks.append(_result(found.metadata, result))
    recovered = Recovered.of(found.metadata)
    if recovered is not None and recovered.marked:
        kept = "messages of damaged chunks were kept: cosim.recovered names them"
        checks.append(CheckResult("suspect", "failed", kept))
    checks.append(_certificate(run, found, cut=cut))
    try:
        # of a file without damage, the summary is enough to find its messages
        trace = Trace(path, incomplete=bool(walk.damage) or not walk.whole)
        order, transit_ns = _order(trace)
        points, links = _Points(), _Links(trace, run, result, transit_ns)
        for tables in trace.parts():
            points.add(tables)
            links.add(tables)
    except CosimError as error:
        return [*checks, CheckResult("rows", "failed", error.text().replace("\n", ";"))]
    checks += [order, points.check(run, result)]
    checks += checks_of_links(links.finished(), whole=result is not None)
    return checks


def _beginning(found: FileChecks, run: Mapping[str, str], *, cut: bool) -> CheckResult:
    """Check that cosim.run comes first, and that attached files have the hashes it names."""
    problems: list[str] = []
    if found.first != Opcode.METADATA or found.metadata[0][0] != layout.RUN:
        problems.append("cosim.run is not the first record")
    named = {name: run[key] for key, name in _HASHED.items() if key in run}
    missing = [f"{name} is not attached" for name in named if name not in found.attached]
    problems += [
        f"{name} is not the file of the SHA-256 that cosim.run names"
        for name, expected in named.items()
        if found.attached.get(name, expected) != expected
    ]
    check = check_result("run", problems, f"cosim.run first; {len(named)} attached files as named")
    return with_missing(check, missing, cut=cut)


def _fmus(
    run: Mapping[str, str], attached: Mapping[str, str], folder: Path | None, *, cut: bool
) -> Iterator[CheckResult]:
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
        yield CheckResult("FMUs", "not checked", "cosim.run names none")
        return
    check = check_result("FMUs", problems, f"{', '.join(hashes)}: named by SHA-256, described")
    yield with_missing(check, missing, cut=cut)
    if folder is None:
        return
    if not folder.is_dir():
        raise InputError("there is no such folder", where="`fmus`", got=str(folder))
    there = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in sorted(folder.rglob("*.fmu"))
        if path.is_file()
    }
    absent = [f"{n}: no file of SHA-256 {h}" for n, h in hashes.items() if h not in there]
    found = ", ".join(f"{n}: {there[h]}" for n, h in hashes.items() if h in there)
    yield check_result("FMU files", absent, found)


def _certificate(run: Mapping[str, str], found: FileChecks, *, cut: bool) -> CheckResult:
    certificate = layout.certificate_of(run)
    if certificate is None:
        return CheckResult("certificate", "not checked", "cosim.run names none")
    data = found.certificate
    if data is None:
        missing = [f"{layout.CERTIFICATE_ATTACHMENT} is not attached"]
        return with_missing(check_result("certificate", [], ""), missing, cut=cut)
    if found.attached[layout.CERTIFICATE_ATTACHMENT] != certificate["sha256"]:
        other = "it is not the file of the SHA-256 that cosim.run names"
        return CheckResult("certificate", "failed", other)
    try:
        claim = json.loads(data)["claim"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return CheckResult("certificate", "failed", "it makes no claim")
    if claim != certificate["claim"]:
        return CheckResult("certificate", "failed", "it claims something else than cosim.run says")
    return CheckResult("certificate", "ok", "the file named; its proof: cosim certificate check")


def _result(
    metadata: list[tuple[str, dict[str, str]]], result: Mapping[str, str] | None
) -> CheckResult:
    if result is None:
        return CheckResult("result", "incomplete", "no cosim.result: the run did not finish")
    names = [name for name, _ in metadata]
    if names.count(layout.RESULT) > 1 or names.count(layout.RUN) > 1:
        return CheckResult("result", "failed", "more than one cosim.run or cosim.result")
    if names[-1] != layout.RESULT:
        return CheckResult("result", "failed", f"{names[-1]} comes after cosim.result")
    return CheckResult(
        "result", "ok", f"cosim.result last; status {result.get('status', 'not named')}"
    )


def _order(trace: Trace) -> tuple[CheckResult, int]:
    """Check the order of delivery; and return the longest time of a message on its way [ns]."""
    last, count, longest = 0, 0, 0
    found = None
    for block in trace.blocks():
        heads = block.heads
        log, publish = heads["log"], heads["publish"]
        if not log.size:
            continue
        back = log < np.append(np.uint64(last), log[:-1])
        wrong = back | (publish > log)
        if found is None and wrong.any():
            i = int(np.argmax(wrong))
            topic = trace.channels[int(heads["channel"][i])].topic
            what = f"{topic}: delivered at {log[i]} ns, sent at {publish[i]} ns"
            if back[i]:
                what = f"{topic} at {log[i]} ns comes after {int(log[i - 1]) if i else last} ns"
            found = CheckResult("order", "failed", what)
        count, last = count + log.size, int(log[-1])
        ahead = log > publish
        longest = max(longest, int((log - publish)[ahead].max(initial=0)))
    fine = f"{count} messages in order of delivery, none before it was sent"
    return found or CheckResult("order", "ok", fine), longest


class _Points:
    """The instants at which components have rows, as they pass by."""

    def __init__(self) -> None:
        self._topics: dict[str, _Instants] = {}

    def add(self, tables: Mapping[str, Table]) -> None:
        for topic, table in tables.items():
            if topic.endswith(("/output", "/input")) and len(table):
                self._topics.setdefault(topic, _Instants()).add(table.log_time_ns)

    def check(self, run: Mapping[str, str], result: Mapping[str, str] | None) -> CheckResult:
        """Check that every component has a row at each communication point, or each of its own."""
        topics = self._topics
        if not topics:
            return CheckResult("rows", "not checked", "no component has rows")
        # with events the points of one instant follow each other: (t, 0), (t, 1), ...
        problems = [
            f"{t}: two rows at one instant"
            for t, times in topics.items()
            if times.back or (times.again and "event_mode" not in run)
        ]
        most = max(times.count for times in topics.values())
        status = "" if result is None else result.get("status", "")
        if result is not None and status != "failed":
            steps = result.get("steps", "")
            points = int(steps) + 1 if steps.isdecimal() else most
            for topic, times in topics.items():
                # a component with its own step has rows at its own points, and at the end
                if times.count > points or (times.count < points and times.uneven):
                    problems.append(f"{topic}: {times.count} rows, {points} communication points")
        if status in ("finished", "limit_cycle") and "end_ns" in run:
            late = [t for t, times in topics.items() if str(times.last) != run["end_ns"]]
            problems += [f"{topic} does not reach the end, {run['end_ns']} ns" for topic in late]
        return check_result(
            "rows", problems, f"{len(topics)} topics, up to {most} communication points"
        )


class _Instants:
    """The instants of one topic: whether they increase, and by equal steps but for the last."""

    def __init__(self) -> None:
        self.count = self.last = 0
        self.back = self.again = self.uneven = False
        self._step: int | None = None
        self._latest = np.zeros(0, np.int64)

    def add(self, times: NDArray[np.int64]) -> None:
        if self.count:
            times = np.append(self.last, times)
        self.count += times.size - bool(self.count)
        self.last = int(times[-1])
        steps = np.diff(times)
        self.back |= bool((steps < 0).any())
        self.again |= bool((steps == 0).any())
        steps = np.append(self._latest, steps)
        self._latest = steps[-1:]
        if steps.size > 1:
            self._step = int(steps[0]) if self._step is None else self._step
            self.uneven |= bool((steps[:-1] != self._step).any())


class _Links:
    """The links of a run, with the rows that their messages may carry."""

    def __init__(
        self,
        trace: Trace,
        run: Mapping[str, str],
        result: Mapping[str, str] | None,
        transit_ns: int,
    ) -> None:
        self._transit_ns = transit_ns
        self._senders: dict[str, Sender] = {}
        self._links: list[tuple[str, str, Link]] = []
        for name in trace.link_names:
            topic, prefix = layout.link_topic(name), f"link.{name}."
            if trace.topics[topic].encoding != "protobuf":
                continue
            declared = _declared(run.get(f"link.{name}"))
            declared["order"] = trace.topics[topic].metadata.get("order")
            entries = (result or {}).items()
            figures = {k.removeprefix(prefix): v for k, v in entries if k.startswith(prefix)}
            signals = [signal.name for signal in trace.topics[topic].signals]
            senders = {n: sender_of(n, trace.topics, self._senders) for n in signals}
            link = Link(name, declared, figures, senders)
            self._links.append((topic, layout.dropped_topic(name), link))

    def add(self, tables: Mapping[str, Table]) -> None:
        for topic, sender in self._senders.items():
            if topic in tables:
                sender.add(tables[topic])
        now = max((int(t.log_time_ns.max()) for t in tables.values() if len(t)), default=0)
        earliest = now - self._transit_ns
        for topic, dropped, link in self._links:
            link.add(tables.get(topic), tables.get(dropped))
            link.compare(everything=False)
            if link.earliest_ns is not None:
                earliest = min(earliest, link.earliest_ns)
        for sender in self._senders.values():
            sender.forget(earliest)

    def finished(self) -> list[Link]:
        """Return the links after the last message."""
        for _, _, link in self._links:
            link.compare(everything=True)
        return [link for _, _, link in self._links]


def _declared(text: str | None) -> dict[str, Any]:
    try:
        declared = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return {}
    return declared if isinstance(declared, dict) else {}
