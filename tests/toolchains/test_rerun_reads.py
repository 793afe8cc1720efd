"""Rerun (the extra `rerun`) loads a trace of ours offline: every message, every topic."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cosim.trace import Poses, Rows, Signal, TraceWriter

pytest.importorskip("rerun", reason='needs pip install "auv-cosim[rerun]"')

LOAD = """
import sys
import rerun
recording = rerun.RecordingStream("trace")
recording.save(sys.argv[2])
recording.log_file_from_path(sys.argv[1])
recording.flush()
recording.disconnect()
"""


def test_rerun_loads_every_message(tmp_path: Path) -> None:
    """Blocks, single rows, poses, links, log lines: counted by its own tool."""
    trace, recording = tmp_path / "a.mcap", tmp_path / "a.rrd"
    times = np.arange(3000, dtype=np.int64) * 1000
    with TraceWriter(trace, run={"seed": "1"}, chunk_bytes=20_000) as writer:
        out = writer.add_topic("/plant/output", [Signal("x"), Signal("y")], schema_name="t.P")
        mixed = writer.add_topic(
            "/link/sc", [Signal("n", kind="int"), Signal("on", kind="bool")], schema_name="t.L"
        )
        values = np.outer(times, [1.0, 2.0])
        writer.write_rows(
            [
                Rows(out, times, values),
                Rows(mixed, times[::10], np.outer(np.arange(300.0), [1.0, 0.0])),
                Poses(times[::100], np.ones((30, 4))),
            ]
        )
        writer.log(int(times[-1]), "info", "test", "done")
        writer.finish({"status": "finished"})
    command = [sys.executable, "-c", LOAD, str(trace), str(recording)]
    subprocess.run(command, check=True)  # noqa: S603 - our own script
    reported = subprocess.run(  # noqa: S603 - the tool under test
        [sys.executable, "-m", "rerun", "rrd", "stats", str(recording)],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    scene = ("/auv/pose", "/auv/hull", "/auv/path", "/tf", "/tf_static")
    for topic in ("/plant/output", "/link/sc", "/log", *scene):
        assert re.search(rf"^{re.escape(topic)}: ", reported, re.MULTILINE), reported
    rows, static = (
        int(re.sub(r"\D", "", re.search(rf"^{name} = (.*)$", reported, re.MULTILINE)[1]))
        for name in ("num_rows", "num_static")
    )
    assert rows - static == 3000 + 300 + 1 + 30 + 1 + 1 + 2
