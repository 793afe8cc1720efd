"""Slaves in processes of their own: same values, states and log lines, and how they can end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from foreign.c_fmu import TYPES, c_fmu, every, talker
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from isolated import children, isolated_slave
from pythonfmu import FmuBuilder
from shared import sampled

from cosim.core import ComponentError, InputError, Worker
from cosim.fmu import FmuDescription, FmuSlave, SlaveProcess, describe_fmu, own_folder

BELL = os.environ.get("BELL") or ("futex" if sys.platform == "linux" else "pipes")
"""What the processes sleep on: Linux has the futex; pipes are for all others."""


@pytest.fixture(scope="module", autouse=True)
def folder_of_this_process() -> None:
    """Made before files are counted, and so are the keepers that serve again."""
    own_folder()
    for worker in [Worker("json:dumps", received=None, method="fresh") for _ in range(3)]:
        worker.close(5.0)


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """No process and no file descriptor."""
    before, files = children(), psutil.Process().num_fds()
    yield
    assert children() <= before
    assert psutil.Process().num_fds() <= files


@pytest.fixture(scope="module")
def fmi3(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    return describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path_factory.mktemp("every")))


@pytest.fixture(scope="module")
def fmi2(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    flags = 'canBeInstantiatedOnlyOncePerProcess="true"'
    folder = tmp_path_factory.mktemp("talker")
    return describe_fmu(c_fmu("talker_fmi2.c", talker(flags=flags), folder))


def hostile(folder: Path, version: str = "2.0") -> FmuDescription:
    return describe_fmu(hostile_fmu(folder, version))


class Log:
    """Collects the messages of a slave."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def __call__(self, level: str, message: str, category: str) -> None:
        self.lines.append((level, message, category))


def used(slave: FmuSlave, value: Any) -> list[Any]:
    """What a slave of every type gives over its life."""
    slave.initialise({"n": 1}, 0.0, None)
    slave.write({f"{kind}.in": "größer" if kind == "String" else value for kind in TYPES})
    found = [slave.read([f"{kind}.out" for kind in TYPES])]
    slave.step(0.0, 0.25)
    return [*found, slave.read([f"{kind}.out" for kind in TYPES])]


def test_values_and_log_lines_are_those_of_a_slave_here(fmi3: FmuDescription) -> None:
    """Every type of FMI 3.0, Strings included; lines of the call are there when it returns."""
    logs, found = (Log(), Log()), []
    with FmuSlave(fmi3, "it", logs[0]) as here:
        found.append(used(here, 1))
    with isolated_slave(fmi3, logs[1]) as there:
        found.append(used(there, 1))
    assert found[0] == found[1]
    assert logs[0].lines == logs[1].lines
    assert len(logs[0].lines) > 0


@pytest.mark.parametrize("version", sampled(["2.0", "3.0"], 1))
def test_states_are_saved_restored_and_serialised(tmp_path: Path, version: str) -> None:
    """As bytes too; the address of a state is one of the other process."""
    with isolated_slave(hostile(tmp_path, version)) as there:
        there.initialise({"u": 1.0}, 0.0, None)
        there.step(0.0, 0.25)
        saved = there.snapshot()
        content = there.serialise(saved)
        there.step(0.25, 0.25)
        assert there.read(["x"]) == {"x": 0.5}
        there.restore(saved)
        assert there.read(["x"]) == {"x": 0.25}
        there.free(saved)
        there.step(0.25, 0.25)
        there.restore(there.deserialise(content))
        assert there.read(["x"]) == {"x": 0.25}
        there.reset()
        there.initialise({"u": 1.0}, 0.0, None)
        assert there.read(["x"]) == {"x": 0.0}


@pytest.mark.parametrize("first", ["here", "isolated"])
def test_fmu_that_allows_one_instance_has_one_in_each_process(
    fmi2: FmuDescription, first: str
) -> None:
    """Isolated ones do not count; without isolation the message names the cure."""
    slaves = [lambda: FmuSlave(fmi2, "here", Log()), lambda: isolated_slave(fmi2)]
    one, other = slaves if first == "here" else reversed(slaves)
    with one() as a, other() as b, isolated_slave(fmi2) as c:
        for slave in (a, b, c):
            slave.initialise({}, 0.0, 1.0)
            slave.step(0.0, 0.5)
        refused = "only once in a process" if first == "here" else None
        if refused:
            with pytest.raises(InputError, match="isolate = true"):
                FmuSlave(fmi2, "another", Log())


SCRIPT = """
import common
from pythonfmu import *

class Counting(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = 0.0
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        common.count += 1
        self.x = float(common.count)
        return True
"""


def test_pythonfmu_slaves_are_apart(tmp_path: Path) -> None:
    """Slaves in one interpreter share `sys.modules`; isolated ones do not."""
    (tmp_path / "common.py").write_text("count = 0\n")
    script = tmp_path / "counting.py"
    script.write_text(SCRIPT)
    path = FmuBuilder.build_FMU(script, dest=tmp_path, project_files=[tmp_path / "common.py"])
    described = describe_fmu(Path(path))
    with FmuSlave(described, "a", Log()) as a, FmuSlave(described, "b", Log()) as b:
        assert taken(a, b) == [2.0, 4.0]
    with isolated_slave(described) as a, isolated_slave(described) as b:
        assert taken(a, b) == [2.0, 2.0]


def taken(*slaves: FmuSlave) -> list[float]:
    """What each counts in two steps."""
    for slave in slaves:
        slave.initialise({}, 0.0, None)
        for k in range(2):
            slave.step(0.1 * k, 0.1)
    return [slave.read(["x"])["x"] for slave in slaves]


def test_process_is_forked_only_where_nothing_foreign_was_loaded(fmi2: FmuDescription) -> None:
    """A fork would have what FMUs have left in this process."""
    code = (
        "import sys; from pathlib import Path\n"
        "from cosim.fmu import FmuSlave, SlaveProcess, describe_fmu\n"
        "from cosim.core import default_method as start_method\n"
        "fmu = describe_fmu(Path(sys.argv[1])); found = [start_method()]\n"
        "process = SlaveProcess('it', fmu); process.wait_until_ready()\n"
        "with FmuSlave(fmu, 'it', print, process=process) as slave:\n"
        "    slave.initialise({}, 0.0, 1.0); found.append(start_method())\n"
        "with FmuSlave(fmu, 'it', lambda *_: None) as slave:\n"
        "    found.append(start_method())\n"
        "print(*found)\n"
    )
    line = [sys.executable, "-c", code, str(fmi2.path)]
    done = subprocess.run(line, capture_output=True, text=True, check=True)  # noqa: S603 - ourselves
    assert done.stdout.splitlines()[-1] == "fork fork fresh"


DEATHS = {"segfault": "SIGSEGV", "kill": "SIGKILL", "exit-0": "exit code 0", "abort": "SIGABRT"}


@pytest.mark.parametrize("fault", sampled(DEATHS, 1))
def test_death_is_named_at_once(tmp_path: Path, fault: str) -> None:
    """In a call over the pipe: component, call, what killed it; others go on, closing is quiet."""
    described, log = hostile(tmp_path), Log()
    with isolated_slave(described) as other, isolated_slave(described, log) as slave:
        other.initialise({"u": 1.0}, 0.0, None)
        slave.initialise(misbehaviour(fault, "step", at=0.5), 0.0, None)
        slave.step(0.0, 0.5)
        began = time.monotonic()
        with pytest.raises(ComponentError, match=DEATHS[fault]) as caught:
            slave.step(0.5, 0.5)
        assert time.monotonic() - began < 1.0
        error = caught.value
        kind = "exited" if fault == "exit-0" else "crashed"
        assert (error.kind, error.component, error.call) == (kind, "it", "fmi2DoStep")
        assert "component 'it' (hostile.fmu)" in error.text()
        with pytest.raises(ComponentError, match="called after the end"):
            slave.read(["x"])
        other.step(0.0, 0.5)
        assert other.read(["x"]) == {"x": 0.5}
    assert slave.end_failure is None
    assert log.lines == []


def test_processes_sleep_on_what_their_system_has(fmi3: FmuDescription) -> None:
    """A channel has descriptors of pipes where there is no futex, and none where there is."""
    process = SlaveProcess("it", fmi3)
    process.wait_until_ready()
    channel = process.channel()
    process.close()
    assert (channel.own == channel.other == -1) is (BELL == "futex")


_OTHER_SYSTEM = """
import sys
import fmpy, numpy, psutil, pytest  # they know this system, and no other
import fmpy.fmi1, fmpy.fmi2, fmpy.fmi3
here, sys.platform = sys.platform, "sunos5"
from cosim.fmu import SlaveProcess  # what processes sleep on is decided when this is loaded
sys.platform = here
sys.exit(pytest.main(sys.argv[1:]))
"""


@pytest.mark.skipif(BELL == "pipes", reason="so it is here")
def test_all_is_the_same_where_there_is_no_futex(tmp_path: Path) -> None:
    """Values, log lines and deaths, with pipes to sleep on."""
    words = "values_and_log_lines or death_is_named or sleep_on_what"
    options = ["-q", "-p", "no:cacheprovider", "--basetemp", str(tmp_path / "base"), "-k", words]
    done = subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-c", _OTHER_SYSTEM, *options, "-m", "", __file__],
        env={k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", "SHARE"))}
        | {"BELL": "pipes"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{2 + len(DEATHS)} passed" in done.stdout


def test_death_while_it_is_freed_is_noted(tmp_path: Path) -> None:
    """Closing raises nothing."""
    log = Log()
    with isolated_slave(hostile(tmp_path), log) as slave:
        slave.initialise(misbehaviour("segfault", "free"), 0.0, None)
    assert slave.end_failure is not None
    assert (slave.end_failure.kind, slave.end_failure.call) == ("crashed", "fmi2FreeInstance")
    assert any("SIGSEGV" in message for _, message, _ in log.lines)


@pytest.mark.slow
def test_call_has_a_limit_once_it_is_initialised(tmp_path: Path) -> None:
    """A hang is ended, and names component, call and limit."""
    with isolated_slave(hostile(tmp_path), call_limit=0.2) as slave:
        slave.initialise(misbehaviour("hang-deaf", "step"), 0.0, None)
        began = time.monotonic()
        with pytest.raises(
            ComponentError, match=r"no answer within 0\.2 s in fmi2DoStep"
        ) as caught:
            slave.step(0.0, 0.5)
        assert 0.2 <= time.monotonic() - began < 1.5
        assert caught.value.kind == "timed-out"
    with isolated_slave(hostile(tmp_path), call_limit=0.05) as slave:
        late = misbehaviour("sleep", "exit", seconds=0.2)  # not during the run
        slave.initialise(late, 0.0, None)


def test_ctrl_c_ends_a_hang(tmp_path: Path) -> None:
    """And the slave: nobody can say what state it is in."""
    with isolated_slave(hostile(tmp_path)) as slave:
        slave.initialise(misbehaviour("hang-deaf", "step"), 0.0, None)
        timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            slave.step(0.0, 0.5)
        timer.join()
    assert slave.end_failure is None


ORPHAN = """
import os, sys, time
from pathlib import Path
from cosim.fmu import FmuSlave, SlaveProcess, describe_fmu
fmu = describe_fmu(Path(sys.argv[1]))
process = SlaveProcess("it", fmu)
process.wait_until_ready()
slave = FmuSlave(fmu, "it", print, process=process)
slave.initialise({"fault": int(sys.argv[2]), "call": int(sys.argv[3])}, 0.0, None)
print(process.number, flush=True)
slave.step(0.0, 0.5)
"""


@pytest.mark.parametrize("fault", sampled(["hang-deaf", "sleep"], 1))
def test_it_ends_with_the_process_of_the_master(tmp_path: Path, fault: str) -> None:
    """However that is killed, and whatever the slave does then."""
    path = hostile(tmp_path).path
    given = misbehaviour(fault, "step")
    line = [sys.executable, "-c", ORPHAN, str(path), str(given["fault"]), str(given["call"])]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as master:  # noqa: S603
        assert master.stdout is not None
        slave = psutil.Process(int(master.stdout.readline()))
        time.sleep(0.1)
        master.kill()
    slave.wait(timeout=5)


_NO_PROCESS = """
import os, sys
from pathlib import Path
from cosim.core import CosimError
from cosim.fmu import FmuSlave, SlaveProcess, describe_fmu
fmu = describe_fmu(Path(sys.argv[1]))
try:
    CODE
    SlaveProcess("it", fmu)
except CosimError as error:
    print(type(error).__name__, error.text())
"""
_GONE = """
    FmuSlave(fmu, "here", lambda *_: None).close()  # what follows it is not forked
    SlaveProcess("it", fmu).close()
    for library in Path(os.environ["XDG_CACHE_HOME"]).rglob("channel-*"):
        library.unlink()
    process = SlaveProcess("it", fmu)
    try:
        process.wait_until_ready()
    finally:
        process.close()
"""


def refusal(fmu: FmuDescription, code: str, **environment: str) -> str:
    """The error of a process that starts that of a slave, after some code."""
    script = _NO_PROCESS.replace("    CODE\n", f"    {code.strip()}\n")
    done = subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-c", script, str(fmu.path)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def test_where_it_cannot_be_a_message_says_so(fmi2: FmuDescription, tmp_path: Path) -> None:
    """On Windows; and without a C compiler where the library is not there yet."""
    windows = refusal(fmi2, 'sys.platform = "win32"')
    assert re.match(
        r"InputError [\s\S]*cannot be isolated on this system[\s\S]*isolate = false", windows
    )
    bare = {"CC": "no-such-compiler", "XDG_CACHE_HOME": str(tmp_path)}
    compiler = refusal(fmi2, "", **bare)
    assert re.match(r"InputError [\s\S]*cannot be isolated here[\s\S]*isolate = false", compiler)
    assert "CC=no-such-compiler" in compiler


def test_process_that_does_not_start_is_named(fmi2: FmuDescription, tmp_path: Path) -> None:
    """For example where its library is gone."""
    gone = refusal(fmi2, _GONE, XDG_CACHE_HOME=str(tmp_path))
    assert re.match(r"ComponentError [\s\S]*'it'[\s\S]*exit code \d", gone)
    assert "did not start" in gone
