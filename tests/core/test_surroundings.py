"""What foreign code changes of a process is put back, or the process is to be replaced."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import stat
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cosim.core import Surroundings

if sys.platform == "win32":
    pytest.skip("there are no children there", allow_module_level=True)

_C = ctypes.CDLL(None)


def in_child(work: Callable[[], object]) -> None:
    """Do something in a process of its own; fail where an assertion in it fails."""
    child = os.fork()
    if not child:
        try:
            work()
        except BaseException as error:  # noqa: BLE001 - told to the parent
            os.write(2, f"{type(error).__name__}: {error}\n".encode())
            os._exit(1)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0


def _change_environment() -> None:
    _C.setenv(b"LEFT", b"1", 1)
    _C.unsetenv(b"PATH")


def _limit_files() -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (100, hard))


@pytest.mark.parametrize(
    "change",
    [
        _change_environment,
        _C.clearenv,
        lambda: os.umask(0o777),
        lambda: signal.setitimer(signal.ITIMER_REAL, 3600.0),
        lambda: signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR2]),
        lambda: _C.setlocale(6, b"C"),
        _limit_files,
    ],
)
def test_what_was_changed_is_put_back(change: Callable[[], object]) -> None:
    """The environment of C and of Python, umask, timers, blocked signals, soft limits, locale."""

    def work() -> None:
        path = os.environ["PATH"]
        surroundings = Surroundings()
        assert surroundings.put_back() == []
        change()
        assert surroundings.put_back() == []
        assert (os.environ["PATH"], os.getenv("LEFT")) == (path, None)
        assert os.umask(0o022) != 0o777
        assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0
        assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == set()
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] != 100

    in_child(work)


def _lower_hard_limit() -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if os.geteuid() == 0:  # who is root can raise it again
        os.setuid(12345)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda: _C.signal(signal.SIGUSR1, ctypes.c_void_p(1)), "what signals do"),
        (lambda: signal.signal(signal.SIGUSR1, print), "what signals do"),
        (lambda: os.close(1), "standard streams"),
        (_lower_hard_limit, "limits of the process"),
    ],
)
def test_what_cannot_be_put_back_is_named(change: Callable[[], object], what: str) -> None:
    """What signals do, by C and by Python; closed streams; limits that only root may raise."""

    def work() -> None:
        surroundings = Surroundings()
        change()
        assert surroundings.put_back() == [what]

    if resource.getrlimit(resource.RLIMIT_CORE)[1] == 0 and what.startswith("limits"):
        pytest.skip("the limit is at its least already")
    in_child(work)


def test_a_run_begins_in_an_empty_folder_of_its_own(tmp_path: Path) -> None:
    """An untouched one serves the next run; one that was left, deleted or written in does not."""

    def work() -> None:
        before = Path.cwd()
        surroundings = Surroundings()

        def entered() -> Path:
            surroundings.enter_folder(tmp_path / "runs")
            assert [*Path().iterdir()] == []
            return Path.cwd()

        first = entered()
        assert entered() == first
        first.rmdir()
        second = entered()
        os.chdir("/")
        third = entered()
        assert not second.exists()
        Path("left").touch()
        fourth = entered()
        fourth.rename(tmp_path / "elsewhere")
        fifth = entered()
        fifth.chmod(stat.S_IRWXU)
        assert len({first, second, third, fourth, fifth}) == 5
        surroundings.close()
        assert Path.cwd() == before
        assert list((tmp_path / "runs").iterdir()) == []

    in_child(work)
