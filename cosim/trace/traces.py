"""Several traces side by side: one data frame, with what differs between the runs as levels."""

from __future__ import annotations

import glob
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from html import escape
from os import PathLike, fspath
from pathlib import Path
from typing import Any, overload

from cosim.core import AnyPath, InputError, Seconds, optional
from cosim.trace.reader import Trace
from cosim.trace.rows import layout
from cosim.trace.tables.column import Align, Between, Joined
from cosim.trace.tables.frames import Framed

_ABOVE = ("scenario", "seed")
_ELSEWHERE = ("title", "description", "run.seed")
_NAME = "trace"
"""The level that tells traces apart where nothing else does: the file's name."""


class Traces(Framed, Sequence[Trace]):
    """Traces of several runs, in the order of their levels.

        >>> from cosim import DelaySystem, Scenario, Traces, run
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> for seed in (1, 2):
        ...     flight = run(tank.set("run.seed", seed), f"runs/{seed}.mcap")
        >>> traces = Traces("runs/*.mcap")
        >>> len(traces), traces.levels["seed"], traces[0].finished
        (2, [1, 2], True)
        >>> traces.to_pandas("tank.x[1]", align=0.5).shape
        (10, 1)

    As a data frame, an Arrow table or a dataset: see `cosim.trace.tables.frames.Framed`.

    Parameters
    ----------
    where : files, folders (every `.mcap` in them), and patterns (`runs/*.mcap`, `runs/**/*.mcap`).
    incomplete : as in `Trace`.

    Attributes
    ----------
    levels : the differences between the runs, by name: `scenario`, `seed`, and keys in which runs
        of one scenario differ (`links.uplink.delay`), with one value per trace, None where a run
        has none; also the file's name, as `trace`, if all of these are the same for two traces.

    Raises
    ------
    InputError : nothing is found there, or a file is no trace.
    LossError : as in `Trace`.
    """

    def __init__(self, *where: AnyPath, incomplete: bool | None = None) -> None:
        for one in where:
            if not isinstance(one, str | PathLike):
                raise InputError(
                    "not a path",
                    where="Traces",
                    expected="paths, one after the other: Traces(*paths)",
                    got=type(one).__name__,
                )
        paths = sorted({path for one in where for path in _paths(fspath(one))})
        traces = [Trace(path, incomplete=incomplete) for path in paths]
        levels = _levels(traces)
        rows = list(zip(*levels.values(), strict=True))
        order = sorted(range(len(traces)), key=lambda i: [_sortable(value) for value in rows[i]])
        self._traces = [traces[i] for i in order]
        self.levels = {name: [values[i] for i in order] for name, values in levels.items()}

    def __len__(self) -> int:
        return len(self._traces)

    @overload
    def __getitem__(self, which: int) -> Trace: ...
    @overload
    def __getitem__(self, which: slice) -> list[Trace]: ...
    def __getitem__(self, which: int | slice) -> Trace | list[Trace]:
        """Return one trace, or a list of them."""
        return self._traces[which]

    def __iter__(self) -> Iterator[Trace]:
        return iter(self._traces)

    def __repr__(self) -> str:
        return f"<Traces: {len(self)}, which differ in {', '.join(self.levels)}>"

    def _repr_html_(self) -> str:
        """Return a table of the traces, as notebooks show it: levels, and how each run ended."""
        rows = []
        for number, trace in enumerate(self):
            ended = "not finished" if trace.outcome is None else trace.outcome.headline
            cells = [*(values[number] for values in self.levels.values()), ended]
            rows.append("".join(f"<td>{escape(str(cell))}</td>" for cell in cells))
        head = "".join(f"<th>{escape(name)}</th>" for name in (*self.levels, "outcome"))
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<p>{escape(repr(self)[1:-1])}</p><table><tr>{head}</tr>{body}</table>"

    def outcomes(self) -> Any:
        """Return a DataFrame with one row per trace: its levels as index, how it ended, metrics.

        A metric that is not a number, text or truth value is left out.
        """
        pd = optional("pandas", extra="tables", what="data frames need pandas")
        rows = []
        for trace in self:
            ended = trace.outcome
            words = {"status": "not finished", "headline": "not finished"}
            if ended is not None:
                words = {"status": ended.status, "headline": ended.headline}
            metrics = {k: v for k, v in leaves(trace.metrics) if not isinstance(v, list)}
            rows.append(words | metrics)
        levels = list(self.levels.values())
        return pd.DataFrame(rows, index=pd.MultiIndex.from_arrays(levels, names=[*self.levels]))

    def _joined(
        self,
        what: str | Sequence[str] | None,
        align: Align,
        between: Between,
        start: Seconds | None,
        end: Seconds | None,
    ) -> tuple[Mapping[str, Sequence[Any]], Sequence[Joined]]:
        """See `Framed`; a signal that a trace does not have is an error there."""
        parts = [
            part
            for trace in self
            for part in trace._joined(what, align, between, start, end)[1]  # noqa: SLF001 - the same
        ]
        return self.levels, parts


def _paths(where: str) -> list[Path]:
    """Return the files that one argument names."""
    path = Path(where)
    if path.is_dir():
        found = sorted(path.glob("*.mcap"))
    elif path.exists():
        found = [path]
    else:
        found = [Path(one) for one in glob.glob(where, recursive=True)]  # noqa: PTH207 - any root
    if not found:
        raise InputError(
            "there is no trace", where=where, expected="a file, a folder, or a pattern: runs/*.mcap"
        )
    return found


def _levels(traces: list[Trace]) -> dict[str, list[Any]]:
    """Return what differs between the runs; see `Traces`."""
    known = [_known(trace) for trace in traces]
    names = list(dict.fromkeys(name for one in known for name in one))

    def differs(name: str) -> bool:
        alike = "" if name in _ABOVE else "scenario"  # compared with runs of the same scenario
        values = {(one.get(alike), one.get(name)) for one in known}
        return len(values) > len({scenario for scenario, _ in values})

    levels = {name: [one.get(name) for one in known] for name in names if differs(name)}
    if len({repr(row) for row in zip(*levels.values(), strict=True)}) < len(traces) or not levels:
        levels[_NAME] = [str(trace.path) for trace in traces]
    return levels


def _sortable(value: Any) -> tuple[bool, bool, Any]:
    """Return what sorts before what: nothing, numbers, text."""
    return value is not None, isinstance(value, str), 0 if value is None else value


def _known(trace: Trace) -> dict[str, Any]:
    """Return what a trace says of its run: scenario, seed, and each key of the scenario.

    A list is its text, so that it can stand in an index.
    """
    found: dict[str, Any] = {"scenario": trace.run.get("scenario")}
    if "seed" in trace.run:
        found["seed"] = int(trace.run["seed"])
    text = trace.attachments.get(layout.SCENARIO_ATTACHMENT, b"").decode("utf-8", "replace")
    with suppress(tomllib.TOMLDecodeError):
        found |= {k: v for k, v in leaves(tomllib.loads(text)) if k not in _ELSEWHERE}
    return {k: json.dumps(v, default=str) if isinstance(v, list) else v for k, v in found.items()}


def leaves(values: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and value of every entry that is no table."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{within}{name}.")
        else:
            yield f"{within}{name}", value
