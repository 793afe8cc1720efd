"""A trace in Rerun: the numbers read back from its file, the layout, and nothing sent anywhere."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim, trace_of
from numpy.typing import NDArray
from outcomes.ways import found

from cosim.core import InputError
from cosim.trace import Trace
from cosim.trace.live import view_in_rerun

chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")

STEP_AFTER, LINEAR = 2, 1


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a flight over the acoustic link."""
    folder = tmp_path_factory.mktemp("rerun")
    done = cosim(
        *("trace", "view", trace_of("auv-acoustic"), "--save", "flight.rrd", "--json"), cwd=folder
    )
    assert done.code == 0, done.err
    assert done.json["output"] == "flight.rrd"
    return folder / "flight.rrd"


@pytest.fixture(scope="module")
def chunks(saved: Path) -> dict[str, list[Any]]:
    """Record batches by entity."""
    found: dict[str, list[Any]] = {}
    for piece in chunk.RrdReader(saved).stream():
        found.setdefault(piece.entity_path, []).append(piece)
    return found


def column(pieces: list[Any], name: str) -> tuple[NDArray[np.int64], list[Any]]:
    """Times [ns] and values of a component, in order of time."""
    times, values = [], []
    for piece in pieces:
        if piece.is_static:
            continue
        table = piece.to_record_batch()
        wanted = [c for c in table.schema.names if c.endswith(name)]
        for c in wanted:
            values += table.column(c).to_pylist()
            times += table.column("t").cast("int64").to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], [values[i] for i in order]


def static(pieces: list[Any], name: str) -> Any:
    for piece in pieces:
        table = piece.to_record_batch()
        for c in table.schema.names:
            if piece.is_static and c.endswith(name):
                return table.column(c).to_pylist()[0]
    raise AssertionError(f"no {name}")


@pytest.mark.parametrize(
    ("topic", "signal", "mode"),
    [
        ("/plant/output", "eta.x", LINEAR),
        ("/plant/output", "nu.r", LINEAR),
        ("/plant/input", "force.z", STEP_AFTER),
        ("/controller/output", "moment.z", STEP_AFTER),
        ("/controller/input", "reference.x", STEP_AFTER),
    ],
)
def test_every_number_is_the_recorded_one(
    topic: str, signal: str, mode: int, chunks: dict[str, list[Any]]
) -> None:
    """All samples at their times, exactly; what is held is drawn as steps."""
    pieces = chunks[f"{topic}/{signal}"]
    times, values = column(pieces, "Scalars:scalars")
    rows = Trace(trace_of("auv-acoustic")).read(topic)
    assert np.array_equal(times, rows.log_time_ns)
    assert np.array_equal(np.array(values).ravel(), rows[signal])
    assert static(pieces, "SeriesLines:interpolation_mode") == [mode]


def test_pose_is_the_recorded_one(chunks: dict[str, list[Any]]) -> None:
    """Position and rotation about z, to the four bytes that Rerun has."""
    rows = Trace(trace_of("auv-acoustic")).read("/plant/output")
    pieces = chunks["/world/vehicle"]
    times, places = column(pieces, "Transform3D:translation")
    assert np.array_equal(times, rows.log_time_ns)
    wanted = np.column_stack([rows[f"eta.{axis}"] for axis in "xyz"])
    assert np.allclose(np.array(places)[:, 0], wanted, atol=1e-6)
    _, turns = column(pieces, "Transform3D:quaternion")
    x, y, z, w = np.array(turns)[:, 0].T
    assert not x.any()
    assert not y.any()
    assert np.allclose(2 * np.arctan2(z, w), rows["eta.psi"], atol=1e-6)


def test_limits_age_losses_and_log_are_displayed(chunks: dict[str, list[Any]]) -> None:
    """The limit of the heave force, the designed age, a mark per lost message, the log's lines."""
    assert {v[0] for v in column(chunks["/limits/plant-force.z/0"], "scalars")[1]} == {2500.0}
    assert {v[0] for v in column(chunks["/limits/age/0"], "scalars")[1]} == {1.25}
    lost = next(pieces for path, pieces in chunks.items() if "uplink" in path and "used" in path)
    dropped = Trace(trace_of("auv-acoustic")).read("/link/uplink/dropped")
    assert np.array_equal(column(lost, "scalars")[0], dropped.log_time_ns)
    assert ["master: the end is reached"] in column(chunks["/log"], "TextLog:text")[1]
    reported = static(chunks["/verdict"], "TextDocument:text")[0]
    assert "The guarantee holds for this run" in reported


def test_the_layout_shows_what_is_recorded(saved: Path, chunks: dict[str, list[Any]]) -> None:
    """A view in space, the charts, the log; every entity of a chart exists."""
    reader = chunk.RrdReader(saved)
    (blueprint,) = reader.blueprints()
    kinds: list[str] = []
    queries: list[str] = []
    for piece in reader.stream(store=blueprint):
        table = piece.to_record_batch()
        for name, into in (("class_identifier", kinds), ("ViewContents:query", queries)):
            for column_name in table.schema.names:
                if column_name.endswith(name):
                    rows = table.column(column_name).to_pylist()
                    into += [value for row in rows for value in row or ()]
    assert {"3D", "TimeSeries", "TextLog", "TextDocument"} <= set(kinds)
    charts = [q.removeprefix("+ ") for q in queries if "$origin" not in q]
    assert len(charts) > 20
    assert set(charts) <= set(chunks)


def test_the_same_trace_gives_the_same_recording(saved: Path, tmp_path: Path) -> None:
    """The identifier of the recording is that of its content."""
    again = view_in_rerun(trace_of("auv-acoustic"), tmp_path / "again.rrd")
    assert again.output is not None
    ours, theirs = (chunk.RrdReader(p).recordings()[0] for p in (saved, again.output))
    assert ours.recording_id == theirs.recording_id


def test_a_trace_without_a_pose_and_with_infinite_numbers(tmp_path: Path) -> None:
    """The paper's example has no view in space; infinite numbers are drawn without failing."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "trace" / "report"))
    try:
        from report_files import foreign  # noqa: PLC0415
    finally:
        sys.path.pop(0)
    for path in (
        trace_of("paper-example"),
        found("far").trace,
        foreign(tmp_path / "foreign.mcap"),
    ):
        viewed = view_in_rerun(path, tmp_path / f"{path.stem}.rrd")
        assert viewed.charts > 0
        names = {piece.entity_path for piece in chunk.RrdReader(viewed.output).stream()}
        assert ("/world/vehicle" in names) == (path.stem == "far")
    assert "/lab/sensors/1/temperature" in names


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> Callable[[str | None], list[str]]:
    """Call with what the viewer is to say of its settings, None for the truth.

    It is asked, and not opened: what it says in the environment in which it would be is returned.
    """
    real = subprocess.run

    def install(answer: str | None) -> list[str]:
        opened: list[str] = []

        def run(command: Sequence[str], **more: Any) -> subprocess.CompletedProcess[str]:
            if "analytics" in command and answer is not None:
                return subprocess.CompletedProcess(command, 0, answer, "")
            if not any(word.endswith(".rrd") for word in command):
                return real(command, **more)
            line = [*command[: command.index("rerun") + 1], "analytics", "config"]
            done = real(line, env=more["env"], capture_output=True, text=True, check=False)
            opened.append(done.stdout + done.stderr)
            return subprocess.CompletedProcess(command, 0, "", "")

        monkeypatch.setattr(subprocess, "run", run)
        return opened

    monkeypatch.setenv("DISPLAY", ":0")
    return install


def test_usage_figures_are_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, viewer: Callable[[str | None], list[str]]
) -> None:
    """The viewer itself reports it, in the environment in which it is started."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    opened = viewer(None)
    assert view_in_rerun(trace_of("paper-example")).output is None
    (reported,) = opened
    assert '"analytics_enabled": false' in reported
    assert not (tmp_path / "home" / ".config").exists()


def test_viewer_is_not_started_unless_usage_figures_are_off(
    viewer: Callable[[str | None], list[str]],
) -> None:
    """It is refused if this cannot be verified."""
    opened = viewer('"analytics_enabled": true')
    with pytest.raises(InputError, match="could not be switched off"):
        view_in_rerun(trace_of("paper-example"))
    assert opened == []


def test_missing_display_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At once, with a hint; a viewer that fails is reported too."""
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    refused = cosim("trace", "view", trace_of("paper-example"), "--json", cwd=tmp_path)
    assert refused.code == 2
    assert "--save" in refused.error["hint"]
    monkeypatch.setenv("DISPLAY", ":987")  # nobody is there
    failed = cosim("trace", "view", trace_of("paper-example"), "--json", cwd=tmp_path)
    assert failed.code == 2
    assert failed.error["what"] == "the Rerun viewer ended with an error"


def test_recording_that_cannot_be_saved_is_refused(tmp_path: Path) -> None:
    """A folder in the place of the file; no trace."""
    refused = cosim("trace", "view", trace_of("paper-example"), "--save", ".", cwd=tmp_path)
    assert refused.code == 2
    assert cosim("trace", "view", "none.mcap", "--save", "x.rrd", cwd=tmp_path).code == 2
    assert not (tmp_path / "x.rrd").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size there")
def test_recording_that_may_not_grow_is_refused(tmp_path: Path) -> None:
    """And ends: the SDK of Rerun waits for ever for a file that does not take what it has."""
    line = [sys.executable, "-m", "cosim", "trace", "view", str(trace_of("paper-example"))]
    words = shlex.join([*line, "--save", "x.rrd"])
    done = subprocess.run(  # noqa: S603 - ourselves
        ["/bin/sh", "-c", f"ulimit -f 1; exec {words}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("x.rrd: the recording cannot be written\n")
    assert not [*tmp_path.iterdir()]
