"""Settings shared by all tests.

Standing here, in a folder that is no package, this file also puts `tests/` on the import
path, so that a test can say `from truth.dde import solve`: `tests/truth` holds the yardsticks
that share no code with what they measure.
"""

from __future__ import annotations

import os
import signal
import threading
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
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


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of every python FMU (NAME.fmu), built once per session; read only."""
    from fmu_src.build import FLAVOUR, ensure_all  # noqa: PLC0415 - most tests need no FMU

    root = tmp_path_factory.mktemp("fmus")
    ensure_all(root)
    return root / FLAVOUR


@pytest.fixture(scope="session")
def native_fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of every native FMU of FMI 2.0 for this machine; read only."""
    return _native(tmp_path_factory, "native")


@pytest.fixture(scope="session")
def native_fmus_of_fmi3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of every native FMU of FMI 3.0 for this machine; read only."""
    return _native(tmp_path_factory, "native-fmi3")


def _native(tmp_path_factory: pytest.TempPathFactory, flavour: str) -> Path:
    from fmu_src.build import ensure_all  # noqa: PLC0415 - most tests need no FMU

    root = tmp_path_factory.mktemp("fmus")
    ensure_all(root, flavour=flavour)
    return root / flavour
