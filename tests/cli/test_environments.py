"""Systems that lack something: an encoding, a home, a folder to write to, fork, locks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from shared import fmu_store

ROOT = Path(__file__).parents[2]
WITHOUT = """
import os, signal, sys
for module, names in (
    (os, ("fork", "forkpty", "killpg", "setsid", "setpgid", "sched_getaffinity", "geteuid")),
    (signal, ("SIGHUP",)),
):
    for name in names:
        vars(module).pop(name, None)
sys.modules["fcntl"] = sys.modules["resource"] = None
from cosim.cli.entry import main
main()
"""
"""The command where the calls are missing that other systems do not have."""
BARE = {
    "PATH": os.environ["PATH"],
    "PYTHONPATH": str(ROOT),
    "PYTHONIOENCODING": "cp1252",
    "PYTHONUTF8": "0",
    "LC_ALL": "C",
}
"""The environment of a service: no home, the encoding of Windows."""


def cosim(*arguments: str | Path, cwd: Path, without: bool = False) -> tuple[int, str]:
    """Run the command in a process of its own; return its exit code and all that it printed."""
    start = ["-c", WITHOUT] if without else ["-m", "cosim"]
    done = subprocess.run(  # noqa: S603 - ours
        [sys.executable, *start, *map(str, arguments)],
        env=BARE,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    text = done.stdout.decode("utf-8")
    assert "unexpected" not in text, text
    assert "Traceback" not in text, text
    return done.returncode, text


def test_a_run_without_fork_locks_home_and_unicode(tmp_path: Path) -> None:
    """It runs, writes its trace, and says in UTF-8 what it did; nothing is made beside it."""
    (tmp_path / "s.toml").write_text(
        'extends = "paper-example"\ntitle = "γ ≤ 5 − ψ"\n[run]\nend = 0.5\n', "utf-8"
    )
    code, text = cosim("run", "s.toml", "--fmus", fmu_store(), cwd=tmp_path, without=True)
    assert code == 0, text
    assert "γ ≤ 5 − ψ" in text
    assert {path.name for path in tmp_path.iterdir()} == {"s.toml", "traces"}
    for verb in ("info", "verify"):
        code, text = cosim("trace", verb, "traces/s.mcap", cwd=tmp_path, without=True)
        assert code == 0, text


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [
        "run paper-example",
        "design paper --k1 0.6 --k2 0.2 --save x.json",
        "scenario new mine",
        "fmu build paper --flavour python",
        "study run delay-margin",
        "trace export {trace} -o x.csv",
        "trace report {trace} -o x.html",
        "trace recover {trace}",
        "age paper --ages 0.1 --picture x.png",
        "ssp export paper-example",
    ],
)
def test_a_folder_that_cannot_be_written_is_named(line: str, tmp_path: Path) -> None:
    """Exit code 2, and what cannot be written: in a folder that not even root can write to."""
    folder = Path("/sys/kernel")
    if not folder.is_dir():
        pytest.skip("no folder that root cannot write to")
    trace = tmp_path / "t.mcap"
    trace.symlink_to(ROOT / "traces" / "reference" / "paper-example.mcap")
    words = line.format(trace=trace).split()
    code, text = cosim(*words, cwd=folder)
    assert code in (0, 2), text
    if "recover" not in words:
        assert code == 2, text
        assert "written" in text or "writable" in text, text


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    ["design paper --k1 0.6 --k2 0.2", "fmu check {fmu}", "scenario list", "study list"],
)
def test_other_verbs_need_no_calls_of_posix(line: str, tmp_path: Path) -> None:
    """Without fork, process groups and locks."""
    fmu = fmu_store() / "native" / "WaveField.fmu"
    code, text = cosim(*line.format(fmu=fmu).split(), cwd=tmp_path, without=True)
    assert code == 0, text


def test_a_check_with_a_run_is_refused_by_name_where_there_is_no_child(tmp_path: Path) -> None:
    fmu = fmu_store() / "native" / "WaveField.fmu"
    words = ("fmu", "check", str(fmu), "--run")
    code, text = cosim(*words, cwd=tmp_path, without=True)
    assert (code, "without --run" in text) == (2, True), text


def test_paths_of_windows_are_pointed_out(tmp_path: Path) -> None:
    r"""A scenario with sub\plant.fmu, in quotes that take it and in those that do not."""
    text = "title = 'x'\n[run]\nend = 1.0\nstep = 0.1\n[components.a]\nfmu = {}\n"
    (tmp_path / "a.toml").write_text(text.format(r"'sub\plant.fmu'"), "utf-8")
    (tmp_path / "b.toml").write_text(text.format(r'"C:\Users\plant.fmu"'), "utf-8")
    code, found = cosim("scenario", "check", "a.toml", "b.toml", cwd=tmp_path)
    assert code == 2
    assert "with forward slashes: " in found
    assert r"write single quotes, or forward slashes: 'C:\file', 'C:/file'" in found
