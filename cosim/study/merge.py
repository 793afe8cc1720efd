"""Merge the parts of one study that were executed in different places."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from cosim.core import AnyPath, InputError, copy_whole
from cosim.study.batch import Row
from cosim.study.execution import chosen_runs
from cosim.study.folder import CHECKED, Folder, read_manifest, read_rows
from cosim.study.plan import BESIDE
from cosim.study.run_log import RunLog
from cosim.study.schema import Study
from cosim.study.table import write_table

_AT_ONCE = 1000
_MOST_RANGES = 5


@dataclass(frozen=True)
class MergedStudy:
    """The result of a merge.

    Attributes
    ----------
    folder, results : the folder of the merged study, and its table; the folder while runs are
        missing.
    runs : number of runs that are there, of `count`.
    twice : number of runs that were in several folders, with the same results.
    missing : the first parts that are missing, as `--runs` takes them.
    traces : number of the traces that were copied.
    without_trace : runs whose traces the study keeps, and which no folder has.
    """

    folder: Path
    results: Path
    runs: int
    count: int
    twice: int
    missing: tuple[str, ...]
    traces: int
    without_trace: tuple[int, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return asdict(self) | {"folder": str(self.folder), "results": str(self.results)}


def merge_studies(folders: Sequence[AnyPath], out: AnyPath) -> MergedStudy:
    """Merge folders of one study into one; write its table if all runs are there.

        >>> from cosim import DelaySystem, Scenario, run_study
        >>> from cosim.study import Study, merge_studies
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1]).loaded()
        >>> rates = {"kind": "grid", "path": "components.lag.parameters.A[1,1]", "values": [-1, -2]}
        >>> end = {"x": "final.lag.x[1]"}
        >>> study = Study(title="Lags", scenario="lag", vary=[rates], metrics=end)
        >>> first = run_study(study, "first", scenario=lag, runs="0:1")
        >>> second = run_study(study, "second", scenario=lag, runs="1:2")
        >>> merged = merge_studies(["first", "second"], "lags")
        >>> merged.runs, merged.count, merged.missing
        (2, 2, ())

    Parameters
    ----------
    out : a new folder, or one of this study, whose runs are kept.

    Raises
    ------
    InputError : they are of different studies; a run has different results in two folders; a folder
        cannot be read.
    LossError : `out` cannot be written.
    """
    out = Path(out)
    parts = [
        path for path in dict.fromkeys(map(Path, folders)) if path.absolute() != out.absolute()
    ]
    if not parts:
        raise InputError("there is nothing to merge", where="study merge", expected="folders")
    manifests = {path: read_manifest(path) for path in parts}
    manifest = dict(manifests[parts[0]])
    for path, other in manifests.items():
        check_same_study(parts[0], manifest, path, other)
        manifest["stability"] = manifest.get("stability") or other.get("stability")
    for key in ("run_log", CHECKED):
        manifest.pop(key, None)
    study, count = Study.model_validate(manifest["study"]), int(manifest["count"])
    with ExitStack() as opened, Folder(out) as folder:
        logs = {path: opened.enter_context(read_rows(path)) for path in parts}
        folder.begin(manifest)
        twice = _check_agreement({out: folder.rows, **logs}, count)
        new = _new(logs.values(), folder.rows, count)
        while rows := list(islice(new, _AT_ONCE)):
            folder.append(rows)
        done = folder.rows
        complete = len(done) == count
        if complete:
            manifest.pop("scenario_folder", None)  # the table does not depend on it
            write_table(manifest, done, folder.results)
        wanted = set(chosen_runs(study, done))
        copied = [_copy_traces(path / "traces", folder.traces, wanted) for path in parts]
        there = {_run_of(trace) for trace in folder.traces.glob("run-*.mcap")}
        missing = tuple(_missing(done, count))
        runs = len(done)
    return MergedStudy(
        folder=out,
        results=folder.results if complete else out,
        runs=runs,
        count=count,
        twice=twice,
        missing=missing[:_MOST_RANGES],
        traces=sum(copied),
        without_trace=tuple(sorted(wanted - there)),
    )


def check_same_study(
    here: Path, mine: Mapping[str, Any], there: Path, other: Mapping[str, Any]
) -> None:
    """Check that two manifests are of one study, of which the results are the same bit for bit.

    Raises
    ------
    InputError : they are not; the message names what differs.
    """
    different = [
        f"{what}: {_short(one)} and {_short(two)}"
        for what, one, two in _differences(mine, other)
        if one != two
    ]
    if different or mine["digest"] != other["digest"]:
        raise InputError(
            "these folders are not parts of one study",
            where=str(there),
            expected=f"what {here} has",
            got="; ".join(different) or "another digest",
        )


def _differences(
    mine: Mapping[str, Any], other: Mapping[str, Any]
) -> Iterator[tuple[str, Any, Any]]:
    """Yield what may differ, by its name, in both manifests."""
    for part in ("study", "fmus", "versions"):
        one, two = mine.get(part) or {}, other.get(part) or {}
        for key in sorted(one.keys() | two.keys()):
            if part != "study" or key not in BESIDE:
                name = {"fmus": f"FMU {key}", "versions": f"version of {key}"}.get(part, key)
                yield name, one.get(key), two.get(key)
    yield "count of runs", mine["count"], other["count"]
    yield "flavour of FMUs", mine.get("flavour"), other.get("flavour")
    hashes = mine.get("parts") or {}, other.get("parts") or {}
    for part in ("scenario", "system", "design"):
        one, two = (found.get(part) for found in hashes)
        yield f"hash of the {part}", one and one[:12], two and two[:12]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _check_agreement(logs: Mapping[Path, RunLog], count: int) -> int:
    """Check that a run has the same results wherever it is; return how many are there twice."""
    twice = 0
    for run in range(count):
        there = [path for path, log in logs.items() if run in log]
        if len(there) < 2:
            continue
        twice += 1
        found = [(path, logs[path][run]) for path in there]
        for path, row in found[1:]:
            if _content(row) != _content(found[0][1]):
                raise InputError(
                    f"run {run} has other results in another folder",
                    where=str(path),
                    expected=f"{_short(_content(found[0][1]))}, as in {found[0][0]}",
                    got=_short(_content(row)),
                    hint="a run depends on the study and its number alone: look for what differs "
                    "between the machines, or leave one folder out",
                )
    return twice


def _content(row: Row) -> str:
    """Return what the table has of a row, bit for bit."""
    return json.dumps([row.status, row.reason, *row.values])


def _new(logs: Any, done: RunLog, count: int) -> Iterator[Row]:
    """Yield the rows of runs that are not done, by number."""
    for run in range(count):
        log = None if run in done else next((log for log in logs if run in log), None)
        if log is not None:
            yield log[run]


def _missing(done: RunLog, count: int) -> Iterator[str]:
    """Yield the parts that are missing, as `--runs` takes them."""
    first = None
    for run in range(count + 1):
        there = run == count or run in done
        if there and first is not None:
            yield f"{first}:{run}"
        first = None if there else run if first is None else first


def _copy_traces(source: Path, target: Path, wanted: set[int]) -> int:
    """Copy the traces of the runs that are wanted and not there yet; return their number."""
    new = [
        trace
        for trace in sorted(source.glob("run-*.mcap"))
        if _run_of(trace) in wanted and not (target / trace.name).exists()
    ]
    if new:
        target.mkdir(exist_ok=True)
    for trace in new:
        copy_whole(trace, target / trace.name)
    return len(new)


def _run_of(trace: Path) -> int:
    number = trace.stem.removeprefix("run-")
    return int(number) if number.isdecimal() else -1
