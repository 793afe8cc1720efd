"""The layout of PlotJuggler: XML, as its `xmlLoadState` functions read it (version 3.x)."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from cosim.trace.tables.topic_info import TopicInfo
from cosim.trace.viewers.plots import Plot, PlotSignal, Tab

_COLORS = (
    *("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf"),
    *("#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#1a1a8c", "#8c1a1a"),
)


def layout(topics: dict[str, TopicInfo], tabs: Sequence[Tab]) -> str:
    """Return the layout: a tab of the path seen from above, and the tabs of plots."""
    root = ET.Element("root")
    window = ET.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    above = [t for t, i in topics.items() if i.schema == "foxglove.PoseInFrame" and i.count]
    if above:
        (area,) = _areas(window, "path", 1)
        area.set("name", "path from above: north [m] over east [m]")
        plot = _plot(area, "XYPlot", "Lines")
        for topic, color in zip(above, _COLORS, strict=False):
            east, north = (f"{topic}/pose/position/{axis}" for axis in "yx")
            name = f"{topic}/pose/position/[y;x]"
            attributes = {"name": name, "color": color, "curve_x": east, "curve_y": north}
            ET.SubElement(plot, "curve", attributes)
    for tab in tabs:
        for area, of in zip(_areas(window, tab.title, len(tab.plots)), tab.plots, strict=True):
            _fill(area, of)
    ET.SubElement(window, "currentTabIndex", index="0")
    ET.SubElement(root, "use_relative_time_offset", enabled="1")
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def series_name(curve: PlotSignal) -> str:
    """Return the name that PlotJuggler gives to a curve: `/plant/output/eta_x`."""
    return f"{curve.topic}/{curve.field.replace('.', '/')}"


def _areas(window: ET.Element, title: str, count: int) -> list[ET.Element]:
    """Add a tab with so many areas below each other."""
    tab = ET.SubElement(window, "Tab", tab_name=title, containers="1")
    container = ET.SubElement(tab, "Container")
    sizes = ";".join([f"{1 / count:.6g}"] * count)
    splitter = {"orientation": "-", "count": str(count), "sizes": sizes}
    below = ET.SubElement(container, "DockSplitter", splitter)
    return [ET.SubElement(below, "DockArea") for _ in range(count)]


def _fill(area: ET.Element, of: Plot) -> None:
    area.set("name", f"{of.title} [{of.unit}]" if of.unit else of.title)
    # a value that is held is drawn as steps; one style for all curves of a plot
    stepwise = not any(curve.continuous for curve in of.curves)
    plot = _plot(area, "TimeSeries", "Steps" if stepwise else "Lines")
    for curve, color in zip(of.curves, _COLORS, strict=False):
        ET.SubElement(plot, "curve", name=series_name(curve), color=color)


def _plot(area: ET.Element, mode: str, style: str) -> ET.Element:
    attributes = {"mode": mode, "style": style, "flip_x": "false", "flip_y": "false"}
    plot = ET.SubElement(area, "plot", {**attributes, "line_width": "1.5"})
    ET.SubElement(plot, "limitY")
    return plot
