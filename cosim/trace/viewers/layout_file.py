"""Write the layout of a viewer for one trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cosim.core import InputError, not_written, write_whole
from cosim.trace.reader import Trace
from cosim.trace.tables.topic_info import TopicInfo
from cosim.trace.viewers import lichtblick, plotjuggler
from cosim.trace.viewers.plots import Tab, tabs_of

Viewer = Literal["lichtblick", "plotjuggler"]
"""Viewers that a layout can be written for."""

_Layout = Callable[[dict[str, TopicInfo], Sequence[Tab]], str]
_LAYOUTS: Mapping[Viewer, tuple[str, _Layout]] = {
    "lichtblick": ("json", lichtblick.layout),
    "plotjuggler": ("xml", plotjuggler.layout),
}


@dataclass(frozen=True, slots=True)
class WrittenLayout:
    """A layout that was written.

    Attributes
    ----------
    tabs : title of each tab of plots, and its number of curves.
    left_out : number of curves that there was no room for.
    """

    trace: Path
    path: Path
    viewer: Viewer
    tabs: Mapping[str, int]
    left_out: int

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json`."""
        return {
            "trace": str(self.trace),
            "path": str(self.path),
            "for": self.viewer,
            "tabs": dict(self.tabs),
            "left_out": self.left_out,
        }


def write_layout(trace: Path, viewer: Viewer, target: Path | None = None) -> WrittenLayout:
    """Write a layout that shows a trace: every path in it is one of the trace's own.

    Parameters
    ----------
    target : the file; NAME.lichtblick.json or NAME.plotjuggler.xml beside the trace if None.

    Raises
    ------
    InputError : the trace has nothing to show, or a file cannot be read or written.
    LossError : the trace is damaged.
    """
    found = Trace(trace)
    tabs, left_out = tabs_of(found.topics)
    suffix, layout = _LAYOUTS[viewer]
    if not tabs:
        raise InputError(
            "the trace has nothing to plot",
            where=str(trace),
            expected="protobuf topics with numbers",
            got=", ".join(sorted({i.encoding for i in found.topics.values()})) or "no topics",
        )
    stem = found.path.name.partition(".")[0]
    target = target or found.path.with_name(f"{stem}.{viewer}.{suffix}")
    if target.exists() and target.samefile(found.path):
        raise InputError("the layout would overwrite its trace", where=str(target))
    with not_written("the layout", target):
        write_whole(target, layout(found.topics, tabs).encode())
    counts = {tab.title: sum(len(plot.curves) for plot in tab.plots) for tab in tabs}
    return WrittenLayout(found.path, target, viewer, counts, left_out)
