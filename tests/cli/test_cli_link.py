"""`cosim link`: record, show and fit, as a shell sees them; what they write can be flown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.shell import cosim
from shared import fmu_store

from cosim import Trace

FLIGHT = """
title = "Section 5 over packets"
connect = ["plant.x -> controller.x : uplink", "controller.u -> plant.u : downlink"]

[run]
end = "4 s"
step = "10 ms"

[components.plant]
fmu = "DelayedPlant"

[components.controller]
fmu = "PaperController"

[links.downlink]
kind = "packet"
sample_time = "50 ms"

[links.uplink]
kind = "packet"
sample_time = "20 ms"
on_loss = "zero"
"""
LOSSY = """
delay = "15 ms"
jitter = { kind = "exponential", mean = "20 ms" }
loss = { kind = "chain", transitions = [[0.9, 0.1], [0.2, 0.8]], loss = [0.02, 0.9] }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the FMUs of the plain flights."""
    fmus = tmp_path / "fmus"
    fmus.symlink_to(fmu_store("native"))
    return tmp_path


def log(folder: Path, count: int = 900, name: str = "buoy.csv") -> Path:
    """A log of a buoy: each 2 s, P(loss | loss) 0.88, P(loss | ok) 0.13."""
    random = np.random.default_rng(1)
    lost, rows = False, ["sent,delivered"]
    for k in range(count):
        lost = random.random() < (0.88 if lost else 0.13)
        rows.append(f"{2 * k}," + ("" if lost else f"{2 * k + 0.3 + random.exponential(0.06):.6f}"))
    path = folder / name
    path.write_text("\n".join(rows) + "\n", "utf-8")
    return path


def test_a_recorded_link_does_the_same_again(folder: Path) -> None:
    """What a run's link did, flown again from the CSV, and from the trace: message by message."""
    (folder / "one.toml").write_text(FLIGHT + LOSSY, "utf-8")
    assert cosim("run", "one.toml", cwd=folder).code == 0
    found = cosim("link", "record", "traces/one.mcap", "-o", "log.csv", "--json", cwd=folder).json
    assert found["links"]["uplink"]["messages"] == 201
    assert found["links"]["downlink"]["lost"] == 0
    for name, recording in (("two", "log.csv"), ("three", "traces/one.mcap")):
        text = f'{FLIGHT}recording = "{recording}"\n'
        (folder / f"{name}.toml").write_text(text, "utf-8")
        assert cosim("run", f"{name}.toml", cwd=folder).code == 0
        one, two = (Trace(folder / f"traces/{n}.mcap") for n in ("one", name))
        assert dict(one.links["uplink"]) == dict(two.links["uplink"])
        assert one.links["uplink"]["lost"] > 20
        for topic in ("/link/uplink", "/link/uplink/dropped", "/plant/output"):
            a, b = one.read(topic), two.read(topic)
            for column in ("log_time_ns", "publish_time_ns", "sequence"):
                assert (getattr(a, column) == getattr(b, column)).all()
            assert all((a[c] == b[c]).all() for c in a.columns)
        (folder / "log.csv").unlink(missing_ok=True)
        rerun = cosim("trace", "rerun", f"traces/{name}.mcap", cwd=folder)
        assert rerun.code == 0, "a trace contains the recording that its run replayed"


def test_show_says_what_the_link_was_like(folder: Path) -> None:
    """As text, as JSON and as a picture."""
    path = log(folder)
    picture = folder / "buoy.png"
    result = cosim("link", "show", str(path), "--picture", str(picture), "--json", cwd=folder)
    found = result.json["links"][""]
    assert found["messages"] == 900
    assert found["loss_after_loss"] == pytest.approx(0.88, abs=0.04)
    assert found["loss_after_arrival"] == pytest.approx(0.13, abs=0.04)
    assert found["interval_s"]["median"] == 2.0
    assert sum(int(k) * n for k, n in found["runs_of_losses"].items()) == found["lost"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    text = cosim("link", "show", str(path), cwd=folder).out
    for words in ("900", "P(loss | loss)", "one each 2 s", "outages", "longest"):
        assert words in text


@pytest.mark.slow
def test_a_parquet_file_is_read_as_csv_is(folder: Path) -> None:
    """What a data frame writes: NaN for a lost message; a scenario replays it, too."""
    frames = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    frame = frames.read_csv(log(folder))
    assert frame["delivered"].isna().any()
    frame.to_parquet(folder / "buoy.parquet")
    frame.to_parquet(folder / "other.name")
    for verb in ("show", "fit"):
        answers = []
        for name in ("buoy.csv", "buoy.parquet", "other.name"):
            answer = cosim("link", verb, name, "--json", cwd=folder)
            assert answer.code in (0, 1), answer.err
            answers.append(answer.out.replace(name, "FILE"))
        assert answers[0] == answers[1] == answers[2]
    flight = FLIGHT.replace("20 ms", "2 s").replace(
        'on_loss = "zero"', 'recording = "buoy.parquet"'
    )
    (folder / "flight.toml").write_text(flight)
    run = cosim("run", "flight.toml", "-o", "flight.mcap", cwd=folder)
    assert run.code == 0, run.err
    wrong = frame.rename(columns={"sent": "when"})
    wrong.to_parquet(folder / "wrong.parquet")
    (folder / "cut.parquet").write_bytes((folder / "buoy.parquet").read_bytes()[:-20])
    for name, words in (
        ("wrong.parquet", "there is no column 'sent'"),
        ("cut.parquet", "cannot be"),
    ):
        refused = cosim("link", "show", name, "--json", cwd=folder)
        assert refused.code == 2
        assert words in refused.error["what"]


def test_a_fitted_link_is_one_that_a_scenario_takes(folder: Path) -> None:
    """Exit code 0, what it found as text and JSON, and a table [links.uplink]."""
    path = log(folder)
    result = cosim(
        "link", "fit", str(path), "--states", "2", "-o", "link.toml", "--json", cwd=folder
    )
    assert result.code == 0
    found = result.json["links"]["uplink"]
    assert found["fits"]
    assert found["loss"] in ("gilbert", "gilbert-elliott")
    text = (folder / "link.toml").read_text("utf-8")
    assert text == found["toml"]
    flight = FLIGHT.split("[links.uplink]", maxsplit=1)[0] + text
    (folder / "flight.toml").write_text(flight, "utf-8")
    assert cosim("run", "flight.toml", cwd=folder).code == 0
    seen = cosim("link", "fit", str(path), "--states", "2", cwd=folder).out
    for words in ("gilbert-elliott", "exponential", "runs of", " more", "nothing refuses"):
        assert words in seen


def test_a_link_that_no_model_makes_has_exit_code_1(folder: Path) -> None:
    """The statistic that refuses the best model is named; what was found is printed."""
    path = folder / "clock.csv"
    rows = [f"{k},{int(k % 7 == 3)}" for k in range(600)]
    path.write_text("\n".join(["sent,lost", *rows]) + "\n", "utf-8")
    result = cosim("link", "fit", str(path), "--states", "2", cwd=folder)
    assert result.code == 1
    assert "runs of arrivals" in result.out
    assert "replays it" in result.out
    found = cosim("link", "fit", str(path), "--states", "2", "--json", cwd=folder)
    assert found.code == 1
    assert not found.json["links"]["uplink"]["fits"]
    assert "[links.uplink]" in result.out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("show", "none.csv"), "cannot be read"),
        (("show", "bad.csv"), "line 3, column delivered"),
        (("fit", "bad.csv"), "line 3, column delivered"),
        (("record", "bad.csv", "-o", "out.csv"), "line 3, column delivered"),
        (("fit", "short.csv"), "at least 60"),
        (("fit", "short.csv", "--states", "9"), "2 to 5"),
        (("show", "short.csv", "--node", "x"), "no node 'x'"),
        (("show", "short.csv", "--picture", "x.txt"), "x.txt"),
    ],
)
def test_bad_input_has_exit_code_2(folder: Path, words: tuple[str, ...], expected: str) -> None:
    """With the place and the fact, and no traceback."""
    (folder / "bad.csv").write_text("sent,delivered\n0,1\n2,1\n", "utf-8")
    log(folder, 10, "short.csv")
    result = cosim("link", *words, cwd=folder)
    assert result.code == 2
    assert expected in result.err
    assert "Traceback" not in result.err


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ('recording = "bad.csv"', ["links.uplink.recording", "line 3, column delivered"]),
        ('recording = { file = "short.csv", node = "x" }', ["no node 'x'"]),
        ('recording = { file = "short.csv", replay = "blocks" }', ["recording.block"]),
        ('recording = "short.csv"', ["rhythm", "message 1", "rows"]),
        (
            'recording = { file = "short.csv", rows = "message" }',
            ["recording", "at least 201", "got: 10"],
        ),
        ('recording = "short.csv"\ndelay = "1 s"', ["delay", "recording says"]),
        ("recording = { sent = [0, 1], lost = [2] }", ["no such message", "below 2"]),
        ("recording = 5", ["recording"]),
        ('loss = { kind = "chain", transitions = [[0.5, 0.4], [1, 0]], loss = [0, 1] }', ["add"]),
        ('loss = { kind = "chain", transitions = [[1.0]], loss = [0] }', ["transitions"]),
        ('loss = { kind = "chain", transitions = [[1, 0], [1]], loss = [0, 1] }', ["transitions"]),
        ('loss = { kind = "string" }', ["kind"]),
    ],
)
def test_a_bad_recording_of_a_scenario_is_named(
    folder: Path, keys: str, expected: list[str]
) -> None:
    """Exit code 2, with the key of the scenario or the cell of the file."""
    (folder / "bad.csv").write_text("sent,delivered\n0,1\n2,1\n", "utf-8")
    log(folder, 10, "short.csv")
    (folder / "flight.toml").write_text(FLIGHT + keys + "\n", "utf-8")
    result = cosim("run", "flight.toml", cwd=folder)
    assert result.code == 2
    for words in expected:
        assert words in result.err
    assert "Traceback" not in result.err
