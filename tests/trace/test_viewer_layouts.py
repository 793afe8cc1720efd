"""Layouts of viewers have the form that these read, and every path in them exists."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from recorded_runs import write_topics
from scene_run import scene_run

from cosim.core import InputError
from cosim.trace import Signal, TraceWriter
from cosim.trace.viewers import write_layout


def numbers_of(path: Path) -> dict[str, set[str]]:
    """The fields that are numbers, joined by dots, of each topic: by the official decoder."""
    found: dict[str, set[str]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, row in reader.iter_decoded_messages():
            if channel.topic not in found:
                found[channel.topic] = set(_numbers(row, ""))
    return found


def _numbers(message: Any, before: str) -> Iterator[str]:
    for field in message.DESCRIPTOR.fields:
        if field.message_type is not None and not field.is_repeated:
            yield from _numbers(getattr(message, field.name), f"{before}{field.name}.")
        elif isinstance(getattr(message, field.name), int | float):
            yield before + field.name


def leaves(layout: Any) -> list[str]:
    """The panels of a mosaic; its splits have the form that Lichtblick reads."""
    if isinstance(layout, str):
        return [layout]
    assert set(layout) == {"first", "second", "direction", "splitPercentage"}
    assert layout["direction"] in ("row", "column")
    assert 0 < layout["splitPercentage"] < 100
    return leaves(layout["first"]) + leaves(layout["second"])


def lichtblick(path: Path, tmp_path: Path) -> dict[str, Any]:
    found = json.loads(write_layout(path, "lichtblick", tmp_path / "l.json").path.read_bytes())
    # as `validateLayoutData` of Lichtblick checks
    assert all(isinstance(found[key], dict) for key in ("configById", "globalVariables"))
    assert isinstance(found["playbackConfig"]["speed"], int | float)
    panels = found["configById"]
    visible = leaves(found["layout"])
    for page in panels["Tab!plots"]["tabs"]:
        visible += leaves(page["layout"])
    assert sorted(visible) == sorted(panels)
    return panels


def curves(panels: dict[str, Any]) -> list[dict[str, Any]]:
    return [p for name, c in panels.items() if name.startswith("Plot!") for p in c["paths"]]


def test_every_path_of_lichtblick_is_in_the_trace(tmp_path: Path) -> None:
    path = scene_run()
    panels, there = lichtblick(path, tmp_path), numbers_of(path)
    assert len(curves(panels)) > 30
    for curve in curves(panels):
        topic, _, field = curve["value"].partition(".")
        assert field in there[topic], curve
        assert curve["timestampMethod"] == "receiveTime"
    scene = panels["3D!scene"]
    assert set(scene["topics"]) == {f"/auv/{n}" for n in ("pose", "reference", "hull", "path")}
    assert set(scene["topics"]) <= set(there)
    assert scene["followTf"] == "map"  # of a frame with z down the view stands on its head
    assert panels["RosOut!log"]["topicToRender"] == "/log"


def test_units_stand_in_labels_and_the_reference_beside_its_place(tmp_path: Path) -> None:
    panels = lichtblick(scene_run(), tmp_path)
    plots = {c["foxglovePanelTitle"]: c for n, c in panels.items() if n.startswith("Plot!")}
    place = plots["plant: eta [m]"]
    assert place["yAxisLabel"] == "m"
    assert [p["label"] for p in place["paths"]] == [
        *(f"plant eta.{axis} [m]" for axis in "xyz"),
        *(f"controller reference.{axis} [m]" for axis in "xyz"),
    ]
    ages = plots["links: age_s [s]"]
    assert [p["value"] for p in ages["paths"]] == [
        f"/link/{name}/state.age_s" for name in ("uplink", "downlink")
    ]


def test_every_curve_of_plotjuggler_is_in_the_trace(tmp_path: Path) -> None:
    """Names are topic/field/field; what `xmlLoadState` needs is there."""
    path = scene_run()
    written = write_layout(path, "plotjuggler", tmp_path / "p.xml")
    names = {f"{t}/{f.replace('.', '/')}" for t, fields in numbers_of(path).items() for f in fields}
    root = ET.parse(written.path).getroot()  # noqa: S314 - our own file
    (window,) = root.findall("tabbed_widget")
    assert (root.tag, window.get("parent")) == ("root", "main_window")
    tabs = window.findall("Tab")
    assert [tab.get("tab_name") for tab in tabs] == ["path", *written.tabs]
    for tab in tabs:
        (splitter,) = tab.findall("Container/DockSplitter")
        areas = splitter.findall("DockArea")
        assert int(splitter.get("count", "")) == len(areas)
        sizes = [float(size) for size in splitter.get("sizes", "").split(";")]
        assert len(sizes) == len(areas)
        assert sum(sizes) == pytest.approx(1, abs=1e-4)
        assert all(len(area.findall("plot")) == 1 for area in areas)
    found = root.findall(".//curve")
    assert len(found) > 30
    for curve in found:
        wanted = [curve.get(key) for key in ("curve_x", "curve_y")]
        assert set(wanted if wanted[0] else [curve.get("name")]) <= names
    flat = root.find(".//plot[@mode='XYPlot']/curve")
    assert flat is not None
    assert flat.get("curve_x") == "/auv/pose/pose/position/y"  # east to the right
    styles = {p.get("style") for p in root.findall(".//plot[@mode='TimeSeries']")}
    assert styles == {"Lines", "Steps"}


def test_a_layout_of_many_topics_is_bounded_and_says_so(tmp_path: Path) -> None:
    written = write_layout(write_topics(tmp_path / "many.mcap", 300, rows=1), "lichtblick")
    assert written.path == tmp_path / "many.lichtblick.json"
    assert (len(written.tabs), written.left_out) == (16, 600 - 32)


def test_names_that_need_quotes(tmp_path: Path) -> None:
    """A topic with a blank is quoted; a signal is found by its field, not by its name."""
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/a b/output", [Signal("K[1,3]", unit="1")], schema_name="t.T")
        writer.write(topic, 0, [1.0])
        writer.finish({})
    panels = lichtblick(tmp_path / "a.mcap", tmp_path)
    assert [curve["value"] for curve in curves(panels)] == ['"/a b/output".K_1_3']
    assert "3D!scene" not in panels


def test_a_trace_without_numbers_is_refused(tmp_path: Path) -> None:
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        writer.log(0, "info", "a", "b")
        writer.finish({})
    with pytest.raises(InputError, match="nothing to plot"):
        write_layout(tmp_path / "a.mcap", "plotjuggler")
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
