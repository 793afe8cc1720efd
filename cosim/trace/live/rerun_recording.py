"""Write a trace as a Rerun recording: every signal at its own times, with a layout for the run."""

from __future__ import annotations

import uuid
from typing import Any

import numpy as np

from cosim.trace.report.chart import Chart, Curve
from cosim.trace.report.page_content import Content, Section
from cosim.trace.report.series import Reals

APPLICATION = "auv-cosim"
TIMELINE = "t"
_COLOURS = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (128, 128, 128),
)
_NAMED = {"reference": (150, 150, 150), "limit": (213, 94, 0)}
_LEVELS = {
    "debug": "DEBUG",
    "info": "INFO",
    "warning": "WARN",
    "error": "ERROR",
    "fatal": "CRITICAL",
}
_FAR = 1e30
"""Largest position: Rerun stores them in four bytes."""
_EVENTS = 60
"""Most events in the verdict; the log has all."""
_AT_ONCE = 6
"""Most charts in one tab."""


def recording_of(rr: Any, content: Content, pose: dict[str, Reals]) -> bytes:
    """Return the recording of a trace, with its layout: the content of a file `.rrd`.

    It is laid out in memory: Rerun never returns from a file that must not grow further.

    Parameters
    ----------
    rr : the module `rerun`.
    pose : `t` [s] and `eta.x`, `eta.y`, `eta.z`, `eta.psi` of the vehicle; empty without one.
    """
    import rerun.blueprint as rrb  # noqa: PLC0415 - optional: the extra `rerun`

    number = uuid.uuid5(uuid.NAMESPACE_OID, str(content.info["content_hash"]))
    recording = rr.RecordingStream(APPLICATION, recording_id=number, send_properties=False)
    laid_out = recording.memory_recording()
    recording.send_blueprint(_layout(rrb, content, pose), make_active=False)
    if pose:
        _log_pose(rr, recording, content, pose)
    known: set[str] = set()
    for chart in content.charts:
        for curve in chart.curves:
            path = entity(chart, curve)
            if path not in known and curve.t.size:
                known.add(path)
                _log_curve(rr, recording, path, curve)
        for i, (label, value) in enumerate(chart.bounds):
            path = f"/limits/{chart.key}/{i}"
            ends = np.array(content.span)
            line = Curve(label, ends, np.full(2, value), role="limit", unit=chart.unit)
            _log_curve(rr, recording, path, line)
    if content.log:
        recording.send_columns(
            "/log",
            [_times(rr, np.array([line.t for line in content.log]))],
            rr.TextLog.columns(
                text=[f"{line.name}: {line.message}" for line in content.log],
                level=[_LEVELS.get(line.level, "INFO") for line in content.log],
            ),
        )
    recording.log(
        "/verdict", rr.TextDocument(_verdict(content), media_type="text/markdown"), static=True
    )
    whole: bytes = laid_out.drain_as_bytes()
    return whole


def entity(chart: Chart, curve: Curve) -> str:
    """Return the path of a curve in the recording: `/plant/output/eta.x`, or `/derived/...`."""
    text = curve.source or f"/derived/{chart.key}/{curve.label}"
    parts = (part for part in text.split("/") if part)
    return "".join("/" + "".join(_escaped(c) for c in part) for part in parts)


def _escaped(character: str) -> str:
    return character if character.isalnum() or character in "._-" else f"\\{character}"


def _times(rr: Any, t: Reals) -> Any:
    return rr.TimeColumn(TIMELINE, duration=np.round(t * 1e9).astype("timedelta64[ns]"))


def _log_curve(rr: Any, recording: Any, path: str, curve: Curve) -> None:
    number = curve.role if isinstance(curve.role, int) else 0
    colour = _NAMED.get(str(curve.role), _COLOURS[number % len(_COLOURS)])
    name = f"{curve.label} [{curve.unit}]" if curve.unit else curve.label
    if curve.text is not None:
        style = rr.SeriesPoints(names=name, colors=[colour], markers="Cross")
    else:
        mode = rr.components.InterpolationMode
        style = rr.SeriesLines(
            names=name,
            colors=[colour],
            widths=[1.0 if curve.role in ("limit", "reference") else 1.6],
            interpolation_mode=mode.StepAfter if curve.stepwise else mode.Linear,
        )
    recording.log(path, style, static=True)
    recording.send_columns(path, [_times(rr, curve.t)], rr.Scalars.columns(scalars=curve.values))


def _log_pose(rr: Any, recording: Any, content: Content, pose: dict[str, Reals]) -> None:
    """Log path, set point and the vehicle's frame; x north, y east, z down."""
    place = np.column_stack([pose[axis] for axis in ("eta.x", "eta.y", "eta.z")])
    half = 0.5 * pose["eta.psi"]
    finite = np.isfinite(place).all(axis=1) & np.isfinite(half)
    place, half, t = np.clip(place[finite], -_FAR, _FAR), half[finite], pose["t"][finite]
    if not t.size:
        return
    size = 0.12 * max(float(np.ptp(place, axis=0).max()), 1e-3)
    recording.log("/world", rr.ViewCoordinates.FRD, static=True)
    recording.log("/world/path", rr.LineStrips3D([place], colors=[_COLOURS[0]]), static=True)
    target = content.path["target"] if content.path else None
    if target is not None:
        grey = _NAMED["reference"]
        point = rr.Points3D([target], colors=[grey], radii=[size / 8], labels=["set point"])
        recording.log("/world/set_point", point, static=True)
    axes = rr.Arrows3D(vectors=size * np.eye(3), colors=[_COLOURS[1], _COLOURS[2], _COLOURS[5]])
    recording.log("/world/vehicle/axes", axes, static=True)
    zero = np.zeros(t.size)
    recording.send_columns(
        "/world/vehicle",
        [_times(rr, t)],
        rr.Transform3D.columns(
            translation=place,
            quaternion=np.column_stack([zero, zero, np.sin(half), np.cos(half)]),
        ),
    )


def _layout(rrb: Any, content: Content, pose: dict[str, Reals]) -> Any:
    """Lay out path and log on the left, charts of the whole run on the right."""
    left = []
    if pose:
        left.append(rrb.Spatial3DView(origin="/world", name="Path (x north, y east, z down)"))
    words = [rrb.TextDocumentView(origin="/verdict", name="Verdict")]
    if content.log:
        words.append(rrb.TextLogView(origin="/log", name="Log"))
    left.append(rrb.Tabs(*words))
    columns = [rrb.Vertical(*left, row_shares=[3, 2] if pose else None)]
    if content.charts:
        columns.append(
            rrb.Tabs(*(tab for s in content.sections for tab in _tabs(rrb, s, content.span)))
        )
    return rrb.Blueprint(
        rrb.Horizontal(*columns, column_shares=[2, 3][: len(columns)]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        auto_layout=False,
        auto_views=False,
        collapse_panels=True,
    )


def _tabs(rrb: Any, section: Section, span: tuple[float, float]) -> list[Any]:
    tabs = []
    for first in range(0, len(section.charts), _AT_ONCE):
        some = section.charts[first : first + _AT_ONCE]
        more = f" {first // _AT_ONCE + 1}" if len(section.charts) > _AT_ONCE else ""
        views = [_view(rrb, chart, span) for chart in some]
        tabs.append(rrb.Grid(*views, grid_columns=min(len(views), 2), name=section.title + more))
    return tabs


def _view(rrb: Any, chart: Chart, span: tuple[float, float]) -> Any:
    paths = [entity(chart, curve) for curve in chart.curves if curve.t.size]
    paths += [f"/limits/{chart.key}/{i}" for i in range(len(chart.bounds))]
    name = f"{chart.title} [{chart.unit}]" if chart.unit else chart.title
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=t) for t in span)
    axis = rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))
    return rrb.TimeSeriesView(origin="/", contents=paths, name=name, axis_x=axis)


def _verdict(content: Content) -> str:
    lines = [f"# {_markdown(content.info['run'].get('title', content.name))}"]
    lines.append(f"**{content.status.what}** {_markdown(content.status.why)}")
    if content.guarantee is not None:
        lines.append(f"{content.guarantee.what}: {content.guarantee.why}")
    lines += [f"- {_markdown(each.what)}: {_markdown(each.why)}" for each in content.assertions]
    lines += [f"- {each.t:g} s: {_markdown(each.what)}" for each in content.timeline[:_EVENTS]]
    signs = {"good": "met", "bad": "NOT MET", "open": "open"}
    lines += [
        f"- {signs[check.tone]}: {_markdown(check.what)} ({_markdown(check.why)})"
        for check in content.assumptions
    ]
    return "\n\n".join(lines)


def _markdown(text: str) -> str:
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|!" else c for c in text)
