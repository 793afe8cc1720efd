"""The child process: how it starts, what it has, what it may say, and that nothing of it stays."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from cosim.core import FrameError, Frames, InputError, Method, Output, SharedMemory, Worker

TARGET = "worker_targets:obey"
METHODS: tuple[Method, ...] = ("fork", "fresh", "spawn")
PATIENT_S = 30.0


@contextmanager
def worker(method: Method = "fork", *arguments: Any, **more: Any) -> Iterator[Worker]:
    made = Worker(TARGET, arguments, received=more.pop("received", Any), method=method, **more)
    try:
        yield made
    finally:
        made.close(0.0)


def asked(one: Worker, *words: Any) -> Any:
    one.frames.send(list(words))
    return one.frames.receive(PATIENT_S)


def gone(number: int) -> bool:
    """Whether a process has ended, soon."""
    until = time.monotonic() + PATIENT_S
    while time.monotonic() < until:
        if not psutil.pid_exists(number) or psutil.Process(number).status() == "zombie":
            return True
        time.sleep(0.01)
    return False


@pytest.mark.parametrize("method", METHODS)
def test_it_does_what_it_is_asked_until_nobody_listens(method: Method) -> None:
    """With its arguments, and with objects of this process if it is a fork of that."""
    with worker(method, 1, "two", known=[object()]) as one:
        arguments, known, _, number, _ = asked(one, "tell")
        assert arguments == [1, "two"]
        assert known == (1 if method == "fork" else 0)
        assert number == one.number
        one.let_go()
        assert one.ended_within(PATIENT_S) == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("how", "status"), [(("die", 11), -11), (("leave", 3), 3), (("leave", 0), 0), (("die", 9), -9)]
)
def test_its_end_is_known(method: Method, how: tuple[str, int], status: int) -> None:
    with worker(method) as one:
        one.frames.send(list(how))
        assert one.ended_within(PATIENT_S) == status
        with pytest.raises(EOFError):
            one.frames.receive(PATIENT_S)


@pytest.mark.parametrize("method", ["fork", "fresh"])
def test_what_it_starts_ends_with_it(method: Method) -> None:
    """Also what has left its session, its group and its parent; and however it ends."""
    for how in (["leave", 0], ["die", 11], None):
        with worker(method) as one:
            (daemon,) = asked(one, "daemon")
            assert psutil.pid_exists(daemon)
            if how is not None:
                one.frames.send(how)
                assert one.ended_within(PATIENT_S) is not None
        assert gone(daemon)


@pytest.mark.parametrize("method", METHODS)
def test_kill_ends_it_whatever_it_ignores(method: Method) -> None:
    with worker(method) as one:
        one.frames.send(["ignore"])
        assert one.kill() == -signal.SIGKILL
        assert one.kill() == -signal.SIGKILL


def test_it_dies_with_its_keeper_and_that_is_noticed() -> None:
    with worker("fork") as one:
        *_, number, keeper = asked(one, "tell")
        os.kill(keeper, signal.SIGKILL)
        assert one.ended_within(PATIENT_S) == -signal.SIGKILL
        assert gone(number)


@pytest.mark.slow
def test_a_stopped_keeper_does_not_keep_it_alive() -> None:
    with worker("fork") as one:
        *_, number, keeper = asked(one, "tell")
        os.kill(keeper, signal.SIGSTOP)
        assert one.kill() == -signal.SIGKILL
        assert gone(number)


@pytest.mark.parametrize("method", ["fork", "fresh"])
def test_one_that_asks_to_be_traced_still_dies_of_its_signals(method: Method) -> None:
    """The process that waits for it is no debugger."""
    with worker(method) as one:
        asked(one, "trace")
        one.frames.send(["die", signal.SIGSEGV])
        assert one.ended_within(PATIENT_S) == -signal.SIGSEGV


@pytest.mark.parametrize("method", ["fork", "fresh"])
def test_it_has_no_descriptor_but_its_own(method: Method, tmp_path: Path) -> None:
    """Streams, the connection, and those that it was given."""
    given = (tmp_path / "given").open("w+")
    with (
        given,
        (tmp_path / "secret").open("w"),
        worker(method, descriptors=[given.fileno()]) as one,
    ):
        names = [name for _, name in asked(one, "descriptors")]
        assert str(tmp_path / "given") in names
        assert not any("secret" in name for name in names)
        others = [name for name in names if name.startswith(("/", "socket"))]
        others = [name for name in others if not name.startswith("/proc/")]
        assert len(others) == 2  # what was given, and the connection
        asked(one, "write", b"content")
        assert (tmp_path / "given").read_text() == "content"


def test_fresh_one_has_the_folder_and_the_environment_of_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though its keeper may have begun before."""
    with worker("fresh"):
        pass
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COSIM_TEST", "now")
    with worker("fresh") as one:
        assert asked(one, "environment") == [str(tmp_path), "now"]


def test_a_keeper_serves_one_worker_after_the_other() -> None:
    found = set()
    for _ in range(3):
        with worker("fresh") as one:
            found.add(asked(one, "tell")[-1])
            one.let_go()
            one.ended_within(PATIENT_S)
    assert len(found) == 1


MODULES = """
import sys
sys.path.insert(0, sys.argv[1])
import cosim.page  # a module that no worker needs by itself
from test_worker import asked, worker

for loaded in (False, True):
    with worker("fresh", loaded=loaded) as one:
        print(asked(one, "modules", "cosim.page", "matplotlib"))
"""


def test_a_fresh_one_has_the_modules_of_this_package_that_are_here() -> None:
    """Its keeper has loaded them for all its workers, so that a second run does not wait for it.

    An isolated component waits for none of them. (Asked in a process of its own: a keeper that has
    served another test may have them already.)
    """
    line = [sys.executable, "-c", MODULES, str(Path(__file__).parent)]
    done = subprocess.run(line, capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.splitlines() == ["[]", "['cosim.page']"]


def test_a_keeper_serves_again_though_its_worker_ends_as_it_is_killed() -> None:
    """The command to kill it may come when there is nothing left to kill."""
    for _ in range(20):
        with worker("fresh") as one:
            one.frames.send(["leave", 0])
            assert one.kill() in (0, -signal.SIGKILL)


def test_output_is_read_here() -> None:
    lines: list[tuple[str, str, str]] = []
    with worker("fork") as one:
        asked(one, "print", "a line")
        one.let_go()
        one.ended_within(PATIENT_S)
        output = Output(one.stdout, "stdout", "info")
        output.read(lambda *line: lines.append(line))
    assert lines == [("stdout", "info", "a line")]


@pytest.mark.parametrize(
    "raw",
    [
        struct.pack("<I", 3) + b"\xc1\xc1\xc1",  # no msgpack
        struct.pack("<I", 5) + b"\xdd\xff\xff\xff\xff",  # an array of 2**32 - 1
        struct.pack("<I", 100_000) + b"\x91" * 100_000,  # as deep
        struct.pack("<I", 4) + b"\xa3abc",  # of another type
        struct.pack("<I", 2) + b"\xa1\xff",  # no UTF-8
        struct.pack("<I", 9) + b"\xc7\x06\x011/0 xx",  # no number
    ],
)
def test_what_is_no_message_is_an_error_and_nothing_else(raw: bytes) -> None:
    with worker("fork", received=list[int]) as one:
        one.frames.send(["raw", raw])
        with pytest.raises(FrameError):
            one.frames.receive(PATIENT_S)


def test_a_message_has_a_greatest_length() -> None:
    """An announcement of 4 GB is refused before a byte of it is there."""
    with worker("fork") as one:
        one.frames.send(["announce", 2**32 - 1])
        with pytest.raises(FrameError, match="4294967295"):
            one.frames.receive(PATIENT_S)


def test_nobody_waits_for_one_that_does_not_read() -> None:
    """What it does not take is kept, and `flush` goes on with it; limits and Ctrl-C live on."""
    with worker("fork") as one:
        one.frames.send(["ignore"])
        began = time.monotonic()
        one.frames.send(["raw", bytes(1 << 24)], wait=False)
        assert not one.frames.flush()
        assert time.monotonic() - began < PATIENT_S


def test_messages_are_whole_whatever_their_length() -> None:
    import socket  # noqa: PLC0415 - two ends in one process

    ends = socket.socketpair()
    here, there = (Frames(end, Any) for end in ends)
    sent = [bytes(size) for size in (0, 1, 65531, 65532, 65536, 3_000_000)]

    def send() -> None:
        for one in sent:
            here.send(one)
        here.close()

    thread = threading.Thread(target=send)
    thread.start()
    assert [there.receive(PATIENT_S) for _ in sent] == sent
    thread.join()
    with pytest.raises(EOFError):
        there.receive(PATIENT_S)
    there.close()


def test_shared_memory_cannot_be_taken_away() -> None:
    memory, descriptor = SharedMemory.reserve("cosim-test", 4096)
    with worker("fork", descriptors=[descriptor]) as one:
        assert asked(one, "shrink") == ["Operation not permitted"]
        asked(one, "write", b"seen")
    os.close(descriptor)
    assert bytes(memory.mapping[:4]) == b"seen"


def test_memory_that_is_kept_from_forks_is_not_there() -> None:
    memory, descriptor = SharedMemory.reserve("cosim-test", 4096)
    os.close(descriptor)
    memory.keep_from_forks()
    number = os.fork()
    if number == 0:
        text = Path("/proc/self/maps").read_text("ascii")
        os._exit("cosim-test" in text)
    assert os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]) == 0
    assert "cosim-test" in Path("/proc/self/maps").read_text("ascii")


ALONE = """
import os, sys, threading, time
from cosim.core import Worker, default_method, note_foreign_code
found = [default_method()]
stop = threading.Event()
thread = threading.Thread(target=stop.wait)
thread.start()
found.append(default_method())
stop.set(); thread.join()
found.append(default_method())
note_foreign_code("an FMU")
found.append(default_method())
print(*found)
"""


def run_alone(code: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run code in an interpreter that has no other threads."""
    line = [sys.executable, "-c", code, *words]
    here = os.environ | {"PYTHONPATH": os.pathsep.join([*sys.path])}
    return subprocess.run(  # noqa: S603 - ourselves
        line, capture_output=True, text=True, check=False, timeout=120, env=here
    )


def test_a_process_is_forked_only_where_that_is_safe() -> None:
    """Not with threads, whose locks a fork would have; not after foreign code."""
    assert run_alone(ALONE).stdout.split() == ["fork", "fresh", "fork", "fresh"]


KILLED = """
import os, sys
from cosim.core import Worker
one = Worker("worker_targets:obey", received=object, method=sys.argv[1], patience_s=0.5)
one.frames.send(["tell"]); print(one.frames.receive(30)[3]); one.frames.send(["ignore"])
sys.stdout.flush(); os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize("method", METHODS)
def test_it_ends_when_the_process_that_wants_it_is_killed(method: Method) -> None:
    """Though it listens to nothing."""
    assert gone(int(run_alone(KILLED, method).stdout))


@pytest.mark.parametrize("method", METHODS)
def test_many_at_once_from_many_threads(method: Method) -> None:
    if method == "fork":
        pytest.skip("no process is forked from one with threads")
    numbers: list[int] = []

    def one_after_the_other() -> None:
        for _ in range(3):
            with worker(method) as one:
                numbers.append(asked(one, "tell")[3])

    threads = [threading.Thread(target=one_after_the_other) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENT_S)
    assert len(set(numbers)) == 9


def test_one_that_cannot_be_started_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(os, "fork", refused)
    with pytest.raises(InputError, match=r"no child process[\s\S]*Resource temporarily"):
        Worker(TARGET, received=Any, method="fork")


NOT_STARTED = """
import sys
from cosim.core import ComponentError, Worker
sys.executable = "/bin/false"
try:
    Worker("worker_targets:obey", received=object, method="fresh")
except ComponentError as error:
    print(error.text())
"""


def test_a_keeper_that_does_not_start_is_named() -> None:
    """For example where the interpreter is not as this one."""
    assert "did not start" in run_alone(NOT_STARTED).stdout


def test_a_fork_by_somebody_else_leaves_it_to_its_owner() -> None:
    """For example by multiprocessing: the other process must not end it, nor keep it alive."""
    with worker("fork") as one:
        number = os.fork()
        if number == 0:
            os._exit(0 if one.frames.closed else 1)
        assert os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]) == 0
        assert asked(one, "tell")[3] == one.number
