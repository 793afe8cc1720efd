"""A component that fails during a run, and a file that is not an FMU."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli.shell import cosim

from cosim.trace import Trace

FAILS = """

_step = {name}.do_step


def _refuse(self, current_time, step_size):
    if current_time > 0.45:
        {how}
    return _step(self, current_time, step_size)


{name}.do_step = _refuse
"""
SCENARIO = """
title = "One of two fails"
[run]
end = 1.0
step = 0.1
[components.plant]
fmu = "DelayedPlant"
[components.sea]
fmu = "broken.fmu"
"""


def broken(source: Path, target: Path, how: str) -> None:
    """A copy of WaveField.fmu that fails in the step after 0.45 s.

    Its module gets a name of its own: FMUs of one process share `sys.modules`.
    """
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        module = old.read("resources/slavemodule.txt").decode().strip()
        for entry in old.infolist():
            content = old.read(entry)
            name = entry.filename
            if name == f"resources/{module}.py":
                content += FAILS.format(name="WaveField", how=how).encode()
                name = "resources/broken_slave.py"
            elif name == "resources/slavemodule.txt":
                content = b"broken_slave"
            new.writestr(name, content)


def test_failure_in_a_step_keeps_what_was_recorded(fmus: Path, tmp_path: Path) -> None:
    """Status failed, exit code 4, the reason in words, and the rows up to the failure."""
    broken(fmus / "WaveField.fmu", tmp_path / "broken.fmu", "return False")
    (tmp_path / "s.toml").write_text(SCENARIO)
    result = cosim("run", "s.toml", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert result.code == 4, result.err
    data = result.json
    assert data["status"] == "failed"
    assert "sea" in data["reason"]
    assert "t = 0.5 s" in data["reason"]
    assert data["simulated_s"] == 0.5
    assert "Traceback" not in result.out + result.err
    trace = Trace(tmp_path / data["trace"])
    assert trace.finished
    assert trace.result is not None
    assert trace.result["status"] == "failed"
    rows = trace.read("/sea/output")
    np.testing.assert_array_equal(rows.log_time_ns, np.arange(6) * 100_000_000)
    assert len(trace.read("/plant/output")) == 6
    reported = cosim("trace", "info", data["trace"], cwd=tmp_path)
    assert reported.code == 0
    assert "failed" in reported.out
    assert data["reason"].splitlines()[0][:40] in reported.out


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a valid FMU"),
        (b"PK\x03\x04 and then nothing", "not a valid FMU"),
        (None, "not a valid FMU"),
    ],
    ids=["empty", "cut", "an archive of something else"],
)
def test_file_that_is_no_fmu(
    content: bytes | None, message: str, fmus: Path, tmp_path: Path
) -> None:
    """Refused as bad input, by name, before anything runs."""
    target = tmp_path / "broken.fmu"
    if content is None:
        with zipfile.ZipFile(target, "w") as archive:
            archive.writestr("readme.txt", "no model description")
    else:
        target.write_bytes(content)
    (tmp_path / "s.toml").write_text(SCENARIO)
    result = cosim("run", "s.toml", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert result.code == 2
    assert result.error["what"] == message
    assert "broken.fmu" in result.error["where"]
    assert not (tmp_path / "traces").exists()
