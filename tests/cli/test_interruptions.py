"""Ctrl-C of the command where Python drops the exception: it is not swallowed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

_WORK = """
import signal, sys, threading, time
import cosim.cli.scenario as verbs
from cosim.cli.entry import main

class Dropped:
    def __del__(self):
        signal.raise_signal(signal.{number})

def work(*_, **__):
    Dropped()
    {then}

verbs.answer = work
sys.argv = ["cosim", "scenarios"]
main()
"""
_HANDLED = """
    try:
        time.sleep(60)
    finally:
        time.sleep(1)
        print("put away", flush=True)
"""


def ended(number: str, then: str, folder: Path) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-c", _WORK.format(number=number, then=then)]
    return subprocess.run(  # noqa: S603 - ours
        line, cwd=folder, capture_output=True, text=True, check=False, timeout=50
    )


@pytest.mark.parametrize(
    ("number", "code", "word"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")]
)
@pytest.mark.parametrize("then", ["time.sleep(60)", "pass"], ids=["while it works", "at its end"])
def test_a_signal_that_a_destructor_drops_ends_the_command(
    number: str, code: int, word: str, then: str, tmp_path: Path
) -> None:
    """It comes again; where the command is over before that, the exit code tells it."""
    done = ended(number, then, tmp_path)
    assert (done.returncode, done.stdout) == (code, "")
    assert done.stderr.startswith(f"{word}\n")
    assert "Dropped" not in done.stderr


def test_what_is_put_away_after_a_signal_is_not_interrupted_again(tmp_path: Path) -> None:
    """As long as the exception is handled the signal does not come again."""
    done = ended("SIGINT", _HANDLED.strip(), tmp_path)
    assert (done.returncode, done.stdout) == (130, "put away\n")
    assert "Traceback" not in done.stderr


_LOADING = """
import signal, sys

class Dropped:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

class Finder:
    def find_spec(self, name, *_):
        if name == "cosim.cli.interruptions":
            Dropped()

sys.meta_path.insert(0, Finder())
from cosim.cli.entry import main
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C ends no process by a signal there")
def test_a_signal_that_an_import_drops_ends_the_command(tmp_path: Path) -> None:
    """Before the signals are taken as well; once the entry is loaded they are as they were."""
    line = [sys.executable, "-c", _LOADING]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603
    assert (done.returncode, done.stdout, done.stderr) == (-2, "", "")
    line[-1] = _LOADING.replace("raise_signal(signal.SIGINT)", "strsignal(2)")
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


def test_the_entry_is_loaded_in_any_thread(tmp_path: Path) -> None:
    """Only the main thread may take signals; another one loads it as it is."""
    code = "import threading as t; x = t.Thread(target=__import__, args=['cosim.cli.entry'])\n"
    line = [sys.executable, "-c", code + "x.start(); x.join()"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
