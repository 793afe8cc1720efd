"""Runs in a child process: the same trace as in one process, and a verdict whatever an FMU does."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest
from cli.shell import BUILT_IN, SCENARIOS, cosim
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from shared import fmu_store, sampled

from cosim.core import Method
from cosim.master import Limits
from cosim.scenario import FmuCache, Outcome, Supervision, execute_run, load, prepare
from cosim.trace import Trace, content_hash

PUMP = """
title = "A pump"
[run]
end = 1.0
step = 0.1
[components.pump]
fmu = "pump.fmu"
parameters = {{ u = 2.0, {fault} }}
"""
FUNCTIONS = {
    "step": "DoStep",
    "get": "Get",
    "enter": "EnterInitializationMode",
    "exit": "ExitInitializationMode",
    "terminate": "Terminate",
    "free": "FreeInstance",
}
STARTS, ENDS = ("enter", "exit"), ("terminate", "free")
KEPT = {"step": 6, "get": 5, "enter": 0, "exit": 0, "terminate": 11, "free": 11}
"""Complete rows of a run whose call fails from 0.45 s on, if it is one of the loop."""
WITH_EVENTS = ("events-of-every-kind", "grid-events", "delays-that-vary", "over-a-transport-link")


def pump(folder: Path, call: str, fault: str, version: str = "2.0", limits: str = "") -> None:
    hostile_fmu(folder, version, "pump")
    given = misbehaviour(fault, call, at=0.45 if call in ("step", "get") else 0.0)
    text = PUMP.format(fault=", ".join(f"{name} = {value}" for name, value in given.items()))
    (folder / "s.toml").write_text(text + (f"[limits]\n{limits}\n" if limits else ""))


def judged(folder: Path, call: str, kind: str, version: str = "2.0", *more: str) -> dict[str, Any]:
    """The outcome of a run whose component failed in a call: typed, in a trace that verifies."""
    result = cosim("run", "s.toml", "--out", "t.mcap", "--json", *more, cwd=folder)
    assert result.code == 4, result.out + result.err
    data: dict[str, Any] = result.json
    cause = data["cause"]
    assert (data["status"], cause["version"], cause["kind"]) == ("failed", 1, kind)
    if FUNCTIONS[call] != "":
        assert cause["component"] == "pump"
        assert cause["call"].startswith(f"fmi{version[0]}{FUNCTIONS[call]}")
    seconds = None if call in STARTS else 1.0 if call in ENDS else 0.5
    assert cause["time_s"] == seconds
    assert "pump" in data["reason"]
    trace = Trace(folder / "t.mcap")
    assert trace.finished
    assert trace.result is not None
    assert trace.result["status"] == "failed"
    assert json.loads(trace.result["cause"]) == cause
    rows = 0 if call in STARTS else len(trace.read("/pump/output"))
    assert rows == KEPT[call]
    assert cosim("trace", "verify", "t.mcap", cwd=folder).code == 0
    info = cosim("trace", "info", "t.mcap", cwd=folder).out
    assert "\ufffd" not in info  # the reason has several lines
    assert sorted(p.name for p in folder.glob("t.mcap*")) == ["t.mcap"]
    return data


@pytest.mark.parametrize("version", sampled(["2.0", "3.0"], 1))
@pytest.mark.parametrize("call", FUNCTIONS)
def test_crash_is_named_and_keeps_every_complete_row(
    tmp_path: Path, call: str, version: str
) -> None:
    """Component, call and time; what was complete is in a finished trace; exit code 4."""
    pump(tmp_path, call, "segfault", version)
    data = judged(tmp_path, call, "crashed", version)
    assert "SIGSEGV" in data["reason"]


@pytest.mark.parametrize("call", ["exit", "step", "free"])
@pytest.mark.parametrize("code", [0, 3])
def test_exit_is_no_success(tmp_path: Path, call: str, code: int) -> None:
    """exit(0) is a failure like exit(3)."""
    pump(tmp_path, call, f"exit-{code}")
    assert f"exit code {code}" in judged(tmp_path, call, "exited")["reason"]


@pytest.mark.parametrize(("call", "limit"), [("exit", "start"), ("step", "call"), ("free", "end")])
def test_hanging_call_is_ended_at_its_limit(tmp_path: Path, call: str, limit: str) -> None:
    """Each part of a run has its limit; the message names it."""
    pump(tmp_path, call, "hang", limits=f'{limit} = "0.5 s"')
    began = time.monotonic()
    data = judged(tmp_path, call, "timed-out")
    assert time.monotonic() - began < 8.0
    assert f"limits.{limit}" in data["reason"]


def test_limits_of_the_command_come_first_and_can_be_none(tmp_path: Path) -> None:
    """A run is ended between two steps where it can be; a limit of 0 or none is none."""
    pump(tmp_path, "step", "hang", limits='call = "none"\nend = 0\nrun = "1 h"')
    data = judged(tmp_path, "step", "timed-out", "2.0", "--limit", "run=0.5")
    assert "the run took longer" in data["reason"]
    for wrong in ("walk=1", "run=soon", "memory=2 m", "call=-1"):
        refused = cosim("run", "s.toml", "--limit", wrong, "--json", cwd=tmp_path)
        assert refused.code == 2
        assert wrong in refused.error["where"]


def test_memory_has_a_limit(tmp_path: Path) -> None:
    """A gigabyte is more than 200 MB."""
    pump(tmp_path, "step", "leak", limits='memory = "200 MB"')
    data = judged(tmp_path, "step", "memory")
    assert "more than 200 MB" in data["reason"]


def test_what_an_fmu_prints_is_in_the_log_up_to_a_limit(tmp_path: Path) -> None:
    """Standard output has the JSON alone; 6144 lines are cut to 1000, and the log says so."""
    pump(tmp_path, "step", "flood-stdout")
    result = cosim("run", "s.toml", "--out", "t.mcap", "--json", cwd=tmp_path)
    assert (result.code, result.json["status"]) == (0, "finished")
    log = Trace(tmp_path / "t.mcap").read("/log")
    lines = list(zip(log["name"], log["message"], strict=True))
    printed = [message for name, message in lines if name == "stdout"]
    assert len(printed) == 1000
    assert [line.rstrip("~") for line in printed] == [f"line {i} " for i in range(1000)]
    assert ("stderr", "a flood begins") in lines
    assert any(n == "master" and "the rest is left out" in m for n, m in lines)
    assert cosim("trace", "verify", "t.mcap", cwd=tmp_path).code == 0


LINE = [sys.executable, "-m", "cosim", "run", "s.toml", "--out", "t.mcap", "--json"]


def waiting(process: psutil.Process, folder: Path) -> psutil.Process:
    """The child of a run, once it hangs in a call: it uses a processor."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        for child in process.children(recursive=True):
            if child.cpu_times().user > 0.5:
                return child
        time.sleep(0.05)
    process.kill()  # whoever has started it waits for its end
    raise AssertionError(f"no child hangs; there is {list(folder.iterdir())}")


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)],
    ids=["Ctrl-C", "terminated"],
)
@pytest.mark.parametrize(
    "call",
    [
        "step",
        pytest.param("enter", marks=pytest.mark.slow),
        pytest.param("free", marks=pytest.mark.slow),
    ],
)
def test_interrupt_works_during_a_hang(tmp_path: Path, call: str, number: signal.Signals) -> None:
    """After a second of grace, with a finished trace; nothing is left behind."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    pump(tmp_path, call, "hang")
    with subprocess.Popen(  # noqa: S603 - ourselves
        LINE,
        cwd=tmp_path,
        env=os.environ | {"TMPDIR": str(scratch)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        child = waiting(psutil.Process(process.pid), tmp_path)
        process.send_signal(number)
        began = time.monotonic()
        out, err = process.communicate(timeout=20)
    assert time.monotonic() - began < 10.0
    assert process.returncode == 128 + number
    assert json.loads(out)["error"]["exit_code"] == 128 + number
    assert "Traceback" not in err
    trace = Trace(tmp_path / "t.mcap")
    assert trace.finished
    assert trace.result is not None
    cause = json.loads(trace.result["cause"])
    assert (cause["kind"], cause["component"]) == ("interrupted", "pump")
    assert FUNCTIONS[call] in cause["call"]
    assert (len(trace.read("/pump/output")) if call != "enter" else 0) == KEPT[call]
    assert not child.is_running()
    assert not list(scratch.iterdir())


@pytest.mark.slow
def test_child_of_a_killed_command_ends_itself(tmp_path: Path) -> None:
    """Even in a call that does not return."""
    pump(tmp_path, "step", "hang")
    with subprocess.Popen(LINE, cwd=tmp_path, stdout=subprocess.DEVNULL) as process:  # noqa: S603
        child = waiting(psutil.Process(process.pid), tmp_path)
        process.kill()
    child.wait(timeout=15)


def executed(text: str | Path, folder: Path, method: Method | None) -> Outcome:
    """A run, to METHOD.mcap."""
    loaded = load(str(text))
    prepared = prepare(loaded, FmuCache(fmu_store("native"), loaded.folder, "native"))
    supervision = Supervision(Limits(), method is not None, method)
    return execute_run(prepared, folder / f"{method}.mcap", supervision=supervision)


@pytest.mark.parametrize("name", sampled([*WITH_EVENTS, *BUILT_IN], 3))
def test_trace_is_that_of_a_run_in_one_process(tmp_path: Path, name: str) -> None:
    """Byte by byte: rows, messages, log lines, metrics."""
    valid = SCENARIOS / "valid" / f"{name}.toml"
    text = valid if valid.exists() else name
    here, there = executed(text, tmp_path, None), executed(text, tmp_path, "fork")
    assert here.content_hash == there.content_hash
    assert here.metrics == there.metrics
    assert (here.status, here.reason, here.cause) == (there.status, there.reason, there.cause)
    assert here.final == there.final
    assert here.log_after_end == there.log_after_end
    assert (here.supervised, there.supervised) == (None, "fork")


@pytest.mark.parametrize("method", ["fresh", "spawn"])
@pytest.mark.parametrize(
    "name", sampled(["events-of-every-kind", "auv-direct", "delays-that-vary"], 1)
)
def test_fresh_interpreter_gives_the_same_trace(tmp_path: Path, name: str, method: Method) -> None:
    """Where a fork is not safe, and where there is none that is."""
    valid = SCENARIOS / "valid" / f"{name}.toml"
    text = valid if valid.exists() else name
    here, there = executed(text, tmp_path, None), executed(text, tmp_path, method)
    assert here.content_hash == there.content_hash
    assert here.metrics == there.metrics
    assert there.supervised == method
    assert content_hash(tmp_path / f"{method}.mcap") == here.content_hash


@pytest.mark.parametrize("method", ["fresh", "spawn"])
def test_fresh_interpreter_reports_a_crash(tmp_path: Path, method: Method) -> None:
    """As a forked one."""
    pump(tmp_path, "step", "abort")
    outcome = executed(tmp_path / "s.toml", tmp_path, method)
    assert outcome.cause is not None
    assert (outcome.status, outcome.cause.kind, outcome.cause.time_s) == ("failed", "crashed", 0.5)
    assert outcome.cause.component == "pump"
    assert outcome.steps == 5


def test_refusal_is_typed(tmp_path: Path) -> None:
    """A call that returns an error; the same with and without a child."""
    pump(tmp_path, "step", "error")
    here, there = (executed(tmp_path / "s.toml", tmp_path, m) for m in (None, "fork"))
    assert here.cause is not None
    assert here.cause == there.cause
    assert (here.cause.kind, here.cause.call, here.cause.time_s) == ("refused", "fmi2DoStep", 0.5)


def test_scenario_can_say_that_it_is_not_supervised(tmp_path: Path) -> None:
    """run.supervise = false, and the trace says it."""
    pump(tmp_path, "step", "nothing")
    for more, recorded in (((), None), (("--set", "run.supervise=false"), "no")):
        run = cosim("run", "s.toml", "--out", "t.mcap", "--json", *more, cwd=tmp_path)
        assert run.code == 0, run.err
        trace = Trace(tmp_path / "t.mcap")
        assert trace.result is not None
        found = trace.result["host.supervised"]
        assert found == recorded or found in ("fork", "fresh")
        assert run.json["supervised"] == (None if recorded == "no" else found)


def test_check_of_the_step_survives_a_crash(tmp_path: Path) -> None:
    pump(tmp_path, "step", "segfault")
    result = cosim("run", "s.toml", "--check-step", cwd=tmp_path)
    assert result.code == 4
    assert "it cannot be said" in result.out
    assert "failed" in result.out
