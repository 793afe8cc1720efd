"""Scenarios with `isolate = true`: the same trace, a cause that is typed, nothing left behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Literal

import psutil
import pytest
from cli.shell import BUILT_IN, SCENARIOS, cosim
from foreign.c_fmu import c_fmu, talker
from hostile.hostile_fmu import hostile_fmu
from scenario.test_supervised_runs import LINE, pump
from shared import fmu_store, sampled

from cosim.master import Limits
from cosim.scenario import (
    FmuCache,
    Outcome,
    ScenarioPart,
    Supervision,
    execute_run,
    json_schema,
    load,
    prepare,
)
from cosim.trace import Trace

NAMES = ("auv-acoustic", "paper-example", "events-of-every-kind", "delays-that-vary")
WAYS = [("paper-example", None), ("auv-acoustic", "fork")]
WAYS += [way for way in product(NAMES, ["fork", None]) if way not in WAYS]


def executed(
    name: str, folder: Path, method: Literal["fork", "spawn"] | None, *, isolate: bool
) -> Outcome:
    """A run with its trace, all components isolated or none."""
    valid = SCENARIOS / "valid" / f"{name}.toml"
    text = str(valid) if valid.exists() else name
    names = load(text).scenario.components
    loaded = load(text, [f"components.{n}.isolate={str(isolate).lower()}" for n in names])
    flavour = "python" if name == "paper-example" else "native"
    prepared = prepare(loaded, FmuCache(fmu_store(flavour), loaded.folder, flavour))
    trace = folder / f"{name}-{method}-{isolate}.mcap"
    return execute_run(
        prepared, trace, supervision=Supervision(Limits(), method is not None, method)
    )


@pytest.mark.parametrize(("name", "method"), sampled(WAYS, 1))
def test_trace_is_that_of_one_process(
    tmp_path: Path,
    name: str,
    method: Literal["fork"] | None,
) -> None:
    """Rows, messages, metrics, log; native FMUs and those of pythonfmu; supervised or not."""
    assert name in BUILT_IN or (SCENARIOS / "valid" / f"{name}.toml").exists()
    here = executed(name, tmp_path, method, isolate=False)
    there = executed(name, tmp_path, method, isolate=True)
    assert here.content_hash == there.content_hash
    assert here.metrics == there.metrics
    assert here.final == there.final
    assert (here.status, here.reason) == (there.status, there.reason) == ("finished", None)
    logs = [Trace(outcome.trace).read("/log") for outcome in (here, there)]
    columns = [[list(log[key]) for key in ("name", "message")] for log in logs]
    assert columns[0] == columns[1]


@pytest.mark.slow
def test_fresh_interpreters_give_the_same_trace(tmp_path: Path) -> None:
    """For the run and for its isolated slaves."""
    here = executed("paper-example", tmp_path, None, isolate=False)
    there = executed("paper-example", tmp_path, "spawn", isolate=True)
    assert here.content_hash == there.content_hash


TWICE = """
title = "Two of an FMU that allows one"
[run]
end = 1.0
step = 0.25
[components.a]
fmu = "talker.fmu"
[components.b]
fmu = "talker.fmu"
"""


def test_fmu_of_one_instance_per_process_is_there_twice(tmp_path: Path) -> None:
    """Refused without isolation, and the message names the cure."""
    flags = 'canBeInstantiatedOnlyOncePerProcess="true"'
    c_fmu("talker_fmi2.c", talker(flags=flags), tmp_path).rename(tmp_path / "talker.fmu")
    (tmp_path / "s.toml").write_text(TWICE)
    refused = cosim("run", "s.toml", "--json", cwd=tmp_path)
    assert refused.code == 2
    assert "isolate = true" in refused.error["hint"]
    run = cosim("run", "s.toml", "--json", "--set", "components.b.isolate=true", cwd=tmp_path)
    assert (run.code, run.json["status"]) == (0, "finished"), run.err


def test_key_is_checked_and_in_the_schema() -> None:
    part = json_schema()["$defs"]["ComponentPart"]["properties"]["isolate"]
    assert (part["type"], part["default"]) == ("boolean", False)
    parts = {"a": {"fmu": "a.fmu", "isolate": True}}
    given = {"title": "t", "run": {"end": 1.0, "step": 0.1}, "components": parts}
    assert ScenarioPart.model_validate(given).to_data()["components"] == parts


ISOLATE = ("--set", "components.pump.isolate=true")


@pytest.mark.parametrize("victim", [pytest.param("command", marks=pytest.mark.slow), "child"])
def test_nothing_is_left_when_the_master_is_killed(tmp_path: Path, victim: str) -> None:
    """SIGKILL for the command or for its child, while the isolated slave hangs in a step."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    pump(tmp_path, "step", "hang")
    env = os.environ | {"TMPDIR": str(scratch)}
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([*LINE, *ISOLATE], cwd=tmp_path, env=env, **streams) as command:  # noqa: S603
        try:
            child, slave = hanging(psutil.Process(command.pid))
        except BaseException:
            command.kill()  # leaving would wait for what hangs
            raise
        (psutil.Process(command.pid) if victim == "command" else child).kill()
        slave.wait(timeout=15)
        child.wait(timeout=15)
        if victim == "child":
            assert command.wait(timeout=15) == 4
    if victim == "child":
        assert Trace(tmp_path / "t.mcap").finished
    else:  # what was unpacked is removed by the next one
        subprocess.run(
            [sys.executable, "-c", "from cosim.fmu import own_folder; own_folder()"],
            env=env,
            check=True,
        )
    assert not list(scratch.iterdir())


def hanging(command: psutil.Process) -> tuple[psutil.Process, psutil.Process]:
    """The child of a command, and its isolated slave once that uses a processor.

    Each of the two stands below a keeper: command, keeper, child, keeper, slave.
    """
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        with suppress(psutil.NoSuchProcess):  # a process that ended while it was looked at
            for process in command.children(recursive=True):
                line = process.parents()
                if process.cpu_times().user > 0.5 and line[3:4] == [command]:
                    return line[1], process
        time.sleep(0.05)
    raise AssertionError("no isolated slave hangs")


def test_cause_is_typed_and_the_others_are_freed(tmp_path: Path) -> None:
    """What the user sees: component, call, time, signal, in JSON and in the trace."""
    pump(tmp_path, "step", "segfault")
    hostile_fmu(tmp_path, "2.0", "sound")
    text = (tmp_path / "s.toml").read_text()
    (tmp_path / "s.toml").write_text(text + '[components.sound]\nfmu = "sound.fmu"\n')
    for more in ((), ("--no-supervise",)):
        run = cosim("run", "s.toml", "--out", "t.mcap", "--json", *ISOLATE, *more, cwd=tmp_path)
        assert run.code == 4, run.err
        cause = run.json["cause"]
        assert (cause["kind"], cause["component"], cause["call"]) == (
            *("crashed", "pump", "fmi2DoStep"),
        )
        assert (cause["time_s"], run.json["status"]) == (0.5, "failed")
        assert cause["detail"] == "the process of the component crashed (SIGSEGV)"
        assert "component 'pump' (pump.fmu): the process of the component" in run.json["reason"]
        trace = Trace(tmp_path / "t.mcap")
        assert trace.finished
        assert trace.result is not None
        assert json.loads(trace.result["cause"]) == cause
        assert len(trace.read("/sound/output")) == 6
        ended = run.json["log_after_end"]
        assert {"level": "info", "name": "sound", "message": "freed"} in ended
        assert not any(line["name"] == "pump" for line in ended)


def test_crash_at_the_start_is_typed_too(tmp_path: Path) -> None:
    """Supervised, the run has failed; else the error is raised; the trace says the same."""
    pump(tmp_path, "exit", "segfault")
    causes = []
    for more in ((), ("--no-supervise",)):
        run = cosim("run", "s.toml", "--out", "t.mcap", "--json", *ISOLATE, *more, cwd=tmp_path)
        assert run.code == 4
        if more:
            assert "SIGSEGV" in run.error["what"]
        else:
            assert (run.json["status"], run.json["cause"]["kind"]) == ("failed", "crashed")
        trace = Trace(tmp_path / "t.mcap")
        assert trace.result is not None
        causes.append(json.loads(trace.result["cause"]))
    assert causes[0] == causes[1]
    assert (causes[0]["kind"], causes[0]["component"]) == ("crashed", "pump")
    assert (causes[0]["call"], causes[0]["time_s"]) == ("fmi2ExitInitializationMode", None)
