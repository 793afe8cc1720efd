"""The trace is complete though some FMUs end the process with themselves.

In a child process that is a failure of the component after a complete run; in one process the
trace is finished before any slave is ended.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from cli.shell import cosim
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from shared import sampled

from cosim.trace import Trace

PUMP = """
[components.pump]
fmu = "pump.fmu"
parameters = {{ u = 2.0, {fault} }}
"""
ALONE = '\ntitle = "A pump"\n[run]\nend = 1.0\nstep = 0.1\n'
BESIDE = '\nextends = "auv-direct"\n[run]\nend = 1.0\n'
"""Flies with a companion from rest, which measures the gain, and with the pump in both."""
MESSAGE = "the <pump> has lost its prime"


def scenario(folder: Path, call: str, fault: str, text: str = ALONE, version: str = "2.0") -> None:
    hostile_fmu(folder, version, "pump")
    (folder / "s.toml").write_text(text + PUMP.format(fault=", ".join(settings(call, fault))))


def settings(call: str, fault: str) -> list[str]:
    """Assignments of the pump's parameters."""
    return [f"{name} = {value}" for name, value in misbehaviour(fault, call).items()]


def apart(folder: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command in its own process, which may die."""
    line = [sys.executable, "-m", "cosim", *map(str, words), "--json"]
    return subprocess.run(  # noqa: S603 - ourselves
        line, cwd=folder, capture_output=True, text=True, check=False
    )


RUN = ("run", "s.toml", "--out", "t.mcap")
HERE = (*RUN, "--no-supervise")
IN_ONE_PROCESS = pytest.mark.parametrize("words", [RUN, HERE], ids=["child", "one process"])


@IN_ONE_PROCESS
@pytest.mark.parametrize("version", sampled(["2.0", "3.0"], 1))
@pytest.mark.parametrize(
    ("call", "fault", "number"),
    sampled([("terminate", "abort", signal.SIGABRT), ("free", "segfault", signal.SIGSEGV)], 1),
)
def test_process_that_dies_with_its_slave_leaves_a_whole_trace(
    tmp_path: Path, call: str, fault: str, number: int, version: str, words: tuple[str, ...]
) -> None:
    """Every row, every figure, verified; in a child process also what is printed."""
    scenario(tmp_path, call, fault, version=version)
    done = apart(tmp_path, *words)
    assert [p.name for p in tmp_path.glob("t.mcap*")] == ["t.mcap"]
    trace = Trace(tmp_path / "t.mcap")
    assert trace.finished
    assert trace.result is not None
    if words == HERE:
        assert done.returncode == -number
        assert trace.result["status"] == "finished"
    else:
        assert done.returncode == 4
        assert trace.result["status"] == json.loads(done.stdout)["status"] == "failed"
        cause = json.loads(trace.result["cause"])
        assert cause == json.loads(done.stdout)["cause"]
        name = {"terminate": "Terminate", "free": "FreeInstance"}[call]
        assert (cause["kind"], cause["component"], cause["time_s"]) == ("crashed", "pump", 1.0)
        assert cause["call"] == f"fmi{version[0]}{name}"
        assert trace.result["reason"].startswith("after the run was complete")
    assert json.loads(trace.result["final"]) == {"pump.x": pytest.approx(2.0)}
    assert trace.read("/pump/output")["x"][-1] == pytest.approx(2.0)
    verified = cosim("trace", "verify", "t.mcap", "--json", cwd=tmp_path)
    assert verified.code == 0, verified.out


@IN_ONE_PROCESS
def test_zero_state_run_is_made_before_slaves_are_ended(
    native_fmus: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    """The gain is that of a run whose pump ends as it should."""
    more = ("--flavour", "native", "--fmus", native_fmus.parent)
    scenario(tmp_path, "step", "nothing", BESIDE)
    sound = apart(tmp_path, *words, *more)
    assert sound.returncode == 0, sound.stderr
    (tmp_path / "t.mcap").unlink()
    scenario(tmp_path, "free", "abort", BESIDE)
    died = apart(tmp_path, *words, *more).returncode
    assert died == (-signal.SIGABRT if words == HERE else 4)
    trace = Trace(tmp_path / "t.mcap")
    assert trace.result is not None
    metrics = json.loads(trace.result["metrics"])
    assert metrics == json.loads(sound.stdout)["metrics"]
    assert metrics["gain"] > 0


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_slave_that_refuses_to_terminate_is_reported(tmp_path: Path, version: str) -> None:
    """As a warning, with the words of the FMU: in the summary and as JSON, after the trace."""
    scenario(tmp_path, "terminate", "error", version=version)
    message = [
        {"level": "info", "name": "pump", "message": "terminated"},
        {"level": "error", "name": "pump", "message": MESSAGE},
        {"level": "warning", "name": "pump", "message": "terminating the slave: status 3"},
        {"level": "info", "name": "pump", "message": "freed"},
    ]
    reported = cosim("run", "s.toml", "--json", "--out", "t.mcap", cwd=tmp_path)
    assert (reported.code, reported.json["status"]) == (0, "finished")
    assert reported.json["log_after_end"] == message
    seen = cosim("run", "s.toml", "--out", "t.mcap", cwd=tmp_path)
    assert f"error, not in the trace: pump: {MESSAGE}" in seen.out
    assert "warning, not in the trace: pump: terminating the slave: status 3" in seen.out
    assert "freed" not in seen.out


def test_injection_is_on_disk_before_its_slave_is_ended(tmp_path: Path) -> None:
    """Also for an injection; its refusal to terminate is reported there, too."""
    scenario(tmp_path, "step", "nothing")
    assert cosim(*RUN, cwd=tmp_path).code == 0
    words = ("trace", "inject", "t.mcap", "--into", "pump.fmu", "--map", "pump.x=u", "-o", "i.mcap")
    refuses = [word for each in settings("terminate", "error") for word in ("--set", each)]
    reported = cosim(*words, *refuses, "--json", cwd=tmp_path)
    assert reported.code == 0, reported.err
    late = "terminating the slave: status 3"
    assert {"level": "warning", "name": "pump", "message": late} in reported.json["log_after_end"]
    assert late in cosim(*words, *refuses, cwd=tmp_path).out
    (tmp_path / "i.mcap").unlink()
    dies = [word for each in settings("free", "abort") for word in ("--set", each)]
    assert apart(tmp_path, *words, *dies).returncode == -signal.SIGABRT
    trace = Trace(tmp_path / "i.mcap")
    assert trace.finished
    assert len(trace.read("/pump/output")) == 11


def test_fmu_of_one_instance_is_ended_before_the_zero_state_run(
    native_fmus: Path, tmp_path: Path
) -> None:
    """It runs, and its last log lines are in the trace."""
    source = native_fmus / "AuvPlant.fmu"
    flag = 'canBeInstantiatedOnlyOncePerProcess="{}"'
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(tmp_path / "one.fmu", "w") as new:
        for entry in old.namelist():
            content = old.read(entry)
            if entry == "modelDescription.xml":
                assert flag.format("false").encode() in content
                content = content.replace(*(flag.format(x).encode() for x in ("false", "true")))
            new.writestr(entry, content)
    text = BESIDE + '[components.plant]\nfmu = "one.fmu"\n'
    (tmp_path / "s.toml").write_text(text)
    more = ("--json", "--flavour", "native", "--fmus", native_fmus.parent)
    one = cosim("run", "s.toml", *more, cwd=tmp_path)
    assert one.code == 0, one.err
    (tmp_path / "s.toml").write_text(BESIDE)
    assert one.json["metrics"] == cosim("run", "s.toml", *more, cwd=tmp_path).json["metrics"]
