"""The installed command as a process: signals, pipes, other folders."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from cli.shell import COMMAND, SCENARIOS, cosim
from shared import sampled

from cosim.core import InputError
from cosim.trace import Trace

LONG = (SCENARIOS / "valid" / "over-a-packet-link.toml").read_text("utf-8")
LONG = LONG.replace("end = 1.0", "end = 5000.0").replace("step = 0.1", "step = 0.01")
ROWS = 200


@contextmanager
def started(
    fmus: Path, folder: Path, *options: str, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """A run that has begun to write its trace; its pace leaves it minutes to be interrupted in."""
    (folder / "long.toml").write_text(LONG, "utf-8")
    with subprocess.Popen(  # noqa: S603 - the command under test
        [
            *(COMMAND, "run", "long.toml", "--out", "t.mcap", "--json"),
            *("--fmus", fmus.parent, "--pace", "10", *options),
        ],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | environment,
    ) as process:
        try:
            while written(folder) <= ROWS:
                assert process.poll() is None, process.communicate()
                time.sleep(0.1)
            yield process
        finally:
            process.kill()


def written(folder: Path) -> int:
    """Rows of the plant that anyone can read while the run goes on."""
    try:
        return len(Trace(folder / "t.mcap.partial").read("/plant/output"))
    except InputError:  # not there yet, or nothing in it
        return 0


def readable_rows(folder: Path) -> int:
    """Rows of the plant in what an interrupted run left."""
    assert not (folder / "t.mcap").exists()
    path = folder / "t.mcap.partial"
    reported = cosim("trace", "info", path, "--json", cwd=folder)
    assert reported.code == 0, reported.err
    assert reported.json["finished"] is False
    rows = Trace(path).read("/plant/output")
    assert (rows.log_time_ns[1:] > rows.log_time_ns[:-1]).all()
    return len(rows)


@pytest.mark.parametrize(
    "number",
    sampled([signal.SIGKILL, signal.SIGINT, signal.SIGTERM], 1),
    ids=lambda each: each.name,
)
def test_interrupted_run_leaves_its_rows(
    number: signal.Signals, fmus: Path, tmp_path: Path
) -> None:
    """Ctrl-C: exit 130, SIGTERM: 143, in words, and the trace is finished up to there.

    After a SIGKILL the rows so far are in the .partial file.
    """
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    with started(fmus, tmp_path, TMPDIR=str(scratch)) as process:
        process.send_signal(number)
        out, err = process.communicate()
    assert "Traceback" not in out + err
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        assert json.loads(out)["error"]["exit_code"] == 128 + number
        assert ("interrupted" if number == signal.SIGINT else "terminated") in err
        assert not list(scratch.iterdir()), "temporary folders are left"
        trace = Trace(tmp_path / "t.mcap")
        assert trace.finished
        assert trace.result is not None
        assert trace.result["status"] == "stopped"
        assert json.loads(trace.result["cause"])["kind"] == "interrupted"
        assert len(trace.read("/plant/output")) > ROWS
        assert cosim("trace", "verify", "t.mcap", cwd=tmp_path).code == 0
    else:
        assert process.returncode == -signal.SIGKILL
        assert readable_rows(tmp_path) > ROWS


@pytest.mark.parametrize(
    "number", sampled([signal.SIGINT, signal.SIGTERM], 1), ids=lambda each: each.name
)
def test_interrupted_run_in_one_process_leaves_its_rows(
    number: signal.Signals, fmus: Path, tmp_path: Path
) -> None:
    """With --no-supervise the rows so far are in the .partial file."""
    with started(fmus, tmp_path, "--no-supervise") as process:
        process.send_signal(number)
        out, err = process.communicate()
    assert "Traceback" not in out + err
    assert process.returncode == 128 + number
    assert json.loads(out)["error"]["exit_code"] == 128 + number
    assert Trace(tmp_path / "t.mcap.partial").complete
    assert readable_rows(tmp_path) > ROWS


FULL = """
import resource, sys
from cosim.cli.entry import main
resource.setrlimit(resource.RLIMIT_FSIZE, (700_000, 700_000))
main()
"""


def test_run_on_a_full_disk(fmus: Path, tmp_path: Path) -> None:
    """It stops, says why and leaves with 3; what is on the disk reads and can be recovered."""
    (tmp_path / "long.toml").write_text(LONG, "utf-8")
    command = [sys.executable, "-c", FULL, "run", "long.toml", "--out", "t.mcap", "--json"]
    done = subprocess.run(  # noqa: S603 - the command under test
        # in one process: the limit holds for shared memory, too
        [*command, "--fsync", "--no-supervise", "--fmus", str(fmus.parent)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    error = json.loads(done.stdout)["error"]
    assert "could not be written" in error["what"]
    assert "recover" in error["hint"]
    assert "Traceback" not in done.stderr
    rows = readable_rows(tmp_path)
    assert rows > 1000
    mended = cosim("trace", "recover", "t.mcap.partial", "--json", cwd=tmp_path)
    assert (mended.code, mended.json["lost_bytes"]) == (3, 0)
    assert len(Trace(tmp_path / "t.recovered.mcap").read("/plant/output")) == rows
    assert cosim("trace", "verify", "t.recovered.mcap", cwd=tmp_path).code == 3


@pytest.mark.parametrize("more", [[], ["--json"]], ids=["for people", "for programs"])
def test_closed_output_pipe_exits_quietly(tmp_path: Path, more: list[str]) -> None:
    """`cosim scenario list | true` prints no traceback; 141 as of SIGPIPE, not 1 (a comparison)."""
    with subprocess.Popen(  # noqa: S603 - the command under test
        [COMMAND, "scenario", "list", *more],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        message = process.stderr.read().decode()
    assert process.returncode == 141
    assert "Traceback" not in message
    assert "Exception" not in message


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("more", [[], ["--json"]], ids=["for people", "for programs"])
def test_output_without_room_is_an_error(tmp_path: Path, more: list[str]) -> None:
    """Named, and exit code 3, not 0 or that of a comparison."""
    with Path("/dev/full").open("wb") as nowhere:
        done = subprocess.run(  # noqa: S603 - the command under test
            [COMMAND, "scenario", "list", *more],
            cwd=tmp_path,
            stdout=nowhere,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 3
    assert done.stderr.startswith("the output has no room\n")
    assert "Exception" not in done.stderr


def test_command_gives_its_error_as_json(tmp_path: Path) -> None:
    """The installed command leaves with the code of its error and no traceback."""
    done = subprocess.run(  # noqa: S603 - the command under test
        [COMMAND, "run", "nothing", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert json.loads(done.stdout)["error"]["exit_code"] == 2
    assert "Traceback" not in done.stderr


def test_output_is_utf_8_whatever_the_code_page(tmp_path: Path) -> None:
    """As when Windows sends it to a file: cp1252 has no gamma."""
    done = subprocess.run(  # noqa: S603 - the command under test
        [COMMAND, "run", "\u03b3.toml"],
        cwd=tmp_path,
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0"},
        check=False,
    )
    assert done.returncode == InputError.exit_code
    assert "\u03b3.toml" in done.stderr.decode("utf-8")
