"""The layout of Lichtblick (and of Foxglove, where it comes from): JSON, as both import it.

Form: `LayoutData` of Lichtblick 1.28, whose panels keep what their types `RendererConfig`,
`PlotConfig`, `Config` of the log and `TabPanelConfig` say. What never changes of a panel is in
`lichtblick.json`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from importlib import resources
from typing import Any

from cosim.trace.rows.foxglove_topics import MAP
from cosim.trace.rows.layout import LOG_TOPIC
from cosim.trace.tables.topic_info import TopicInfo
from cosim.trace.viewers.plots import Plot, PlotSignal, Tab

_IN_3D = ("foxglove.PoseInFrame", "foxglove.SceneUpdate")
_REFERENCE_COLOR = "#e8590cff"


def layout(topics: dict[str, TopicInfo], tabs: Sequence[Tab]) -> str:
    """Return the layout: the scene and the log on the left, the plots on the right."""
    fixed = json.loads(resources.files(__package__).joinpath("lichtblick.json").read_text("utf-8"))
    panels: dict[str, Any] = {}
    left = []
    if visible := {t: i for t, i in topics.items() if i.schema in _IN_3D and i.count}:
        panels["3D!scene"] = {**fixed["3D"], **_scene(visible)}
        left.append("3D!scene")
    if LOG_TOPIC in topics:
        panels["RosOut!log"] = {**fixed["RosOut"], "topicToRender": LOG_TOPIC}
        left.append("RosOut!log")
    sides = [_stacked(left, 75)] if left else []
    if tabs:
        pages = []
        for i, tab in enumerate(tabs):
            names = [f"Plot!{i}x{j}" for j in range(len(tab.plots))]
            for name, plot in zip(names, tab.plots, strict=True):
                panels[name] = {**fixed["Plot"], **_plot(plot)}
            pages.append({"title": tab.title, "layout": _stacked(names)})
        panels["Tab!plots"] = {"activeTabIdx": 0, "tabs": pages}
        sides.append("Tab!plots")
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        **({"layout": _split(sides, "row", 50)} if sides else {}),
    }
    return json.dumps(whole, indent=2, allow_nan=False) + "\n"


def message_path(curve: PlotSignal) -> str:
    """Return where a curve is, in the language of message paths: `/plant/output.eta_x`."""
    plain = re.fullmatch(r"(/[A-Za-z0-9_-]*)+", curve.topic)
    topic = curve.topic if plain else json.dumps(curve.topic, ensure_ascii=False)
    return f"{topic}.{curve.field}"


def _scene(visible: dict[str, TopicInfo]) -> dict[str, Any]:
    """Return what is visible; seen in the frame with z up, which the vehicle's has not."""
    settings: dict[str, Any] = {topic: {"visible": True} for topic in visible}
    for topic, info in visible.items():
        if info.schema == "foxglove.PoseInFrame" and topic.endswith("/reference"):
            settings[topic] |= {"type": "arrow", "color": _REFERENCE_COLOR}
    ours = any(info.is_computed for info in visible.values())
    return {"topics": settings, **({"followTf": MAP} if ours else {})}


def _plot(plot: Plot) -> dict[str, Any]:
    paths = [
        {
            "value": message_path(curve),
            "enabled": True,
            "timestampMethod": "receiveTime",
            "label": curve.label,
            "showLine": True,
        }
        for curve in plot.curves
    ]
    title = f"{plot.title} [{plot.unit}]" if plot.unit else plot.title
    return {"paths": paths, "yAxisLabel": plot.unit or "", "foxglovePanelTitle": title}


def _stacked(names: Sequence[str], first: float | None = None) -> Any:
    return _split(names, "column", first)


def _split(parts: Sequence[Any], direction: str, first: float | None = None) -> Any:
    """Put parts beside or below each other: all of one size, or the first with so many per cent."""
    if len(parts) == 1:
        return parts[0]
    return {
        "first": parts[0],
        "second": _split(parts[1:], direction),
        "direction": direction,
        "splitPercentage": first if first is not None else 100 / len(parts),
    }
