"""Settings shared by all tests.

Standing here, in a folder that is no package, this file also puts `tests/` on the import
path, so that a test can say `from truth.dde import solve`: `tests/truth` holds the yardsticks
that share no code with what they measure.
"""

from __future__ import annotations

import gc
import os
import signal
import threading
from contextlib import chdir
from typing import TYPE_CHECKING

import pytest
import shared
from arithmetic import is_usual
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# Drawn without a display, and before anything imports matplotlib.
os.environ["MPLBACKEND"] = "Agg"

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start.
if (
    threading.current_thread() is threading.main_thread()
    and signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run and machine; a slow machine is no failure.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Leave what collecting makes out of every later garbage collection: it all stays to the end.

    With some thousand tests these are millions of objects, and half a second per collection.
    """
    gc.disable()
    result = yield
    gc.collect()
    gc.freeze()
    gc.enable()
    return result


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of the slow tests leave those of the commit's share; what is `always` run stays."""

    def stays(item: pytest.Item) -> bool:
        slow = item.get_closest_marker("slow")
        return not slow or "always" in slow.kwargs or shared.is_in_share(item.nodeid)

    config.hook.pytest_deselected(items=[item for item in items if not stays(item)])
    items[:] = [item for item in items if stays(item)]


@pytest.fixture(scope="session", autouse=True)
def the_disk_is_not_waited_for() -> Iterator[None]:
    """No test cuts the power, and thousands of files that are replaced wait 7 ms each."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """One folder for all processes of the session; see `shared`."""
    base = tmp_path_factory.getbasetemp()
    in_parallel = "PYTEST_XDIST_WORKER" in os.environ
    shared.share_below((base.parent if in_parallel else base) / "shared")


@pytest.fixture(scope="module", autouse=True)
def nothing_shared_is_written() -> Iterator[None]:
    """What all tests read is still as it was made when the tests of a file are done."""
    yield
    written = shared.what_was_written()
    assert not written, f"changed by a test; write to tmp_path instead: {', '.join(written)}"


@pytest.fixture(scope="module", autouse=True)
def the_folder_is_as_before() -> Iterator[None]:
    """No test leaves the process elsewhere, as FMPy does when a library does not load."""
    with chdir("."):
        yield


@pytest.fixture(scope="module", autouse=True)
def arithmetic_is_as_before() -> Iterator[None]:
    """No test leaves another rounding mode behind: the next ones would fail for its sake."""
    yield
    assert is_usual(), "foreign code has changed this process's arithmetic: see cosim.fmu"


@pytest.fixture(scope="session")
def fmus() -> Path:
    """Folder of every python FMU (NAME.fmu), built once per session; read only."""
    return shared.fmu_folder("python")


@pytest.fixture(scope="session")
def native_fmus() -> Path:
    """Folder of every native FMU of FMI 2.0 for this machine; read only."""
    return shared.fmu_folder("native")


@pytest.fixture(scope="session")
def native_fmus_of_fmi3() -> Path:
    """Folder of every native FMU of FMI 3.0 for this machine; read only."""
    return shared.fmu_folder("native-fmi3")
