"""Open a trace in Rerun, or save it for Rerun; no data leave this machine."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.core import InputError, not_written, optional, write_whole
from cosim.trace.live.rerun_recording import recording_of
from cosim.trace.reader import Trace
from cosim.trace.report.page_content import content_of
from cosim.trace.report.series import Reals, Recording
from cosim.trace.report.vehicle import vehicle_of

_RERUN = (sys.executable, "-m", "rerun")
_LOOPBACK = "127.0.0.1"
_NOWHERE = f"http://{_LOOPBACK}:9"
_PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")
_OFF = '"analytics_enabled": false'


@dataclass(frozen=True)
class ViewResult:
    """The result of viewing a trace; `output` is the recording saved, None if none was."""

    trace: Path
    output: Path | None
    charts: int

    def to_json(self) -> dict[str, Any]:
        """Return all fields as JSON values, for `--json`."""
        return {
            "trace": str(self.trace),
            "output": None if self.output is None else str(self.output),
            "charts": self.charts,
        }

    def text(self) -> str:
        """Return the result as one line of text."""
        if self.output is None:
            return f"{self.trace}: the viewer was closed"
        return f"recording: {self.output} ({self.charts} charts); rerun {self.output} opens it"


def view_in_rerun(path: Path, save: Path | None = None) -> ViewResult:
    """Open a trace in the viewer and wait until it is closed, or save the recording.

    Raises
    ------
    InputError : rerun-sdk is not installed, there is no trace or no display, or `save` cannot be
        written.
    """
    rr = optional("rerun", extra="rerun", what="a trace is viewed with rerun-sdk")
    if save is None:
        _check_display()
    content = content_of(path)
    whole = recording_of(rr, content, _pose(path))
    if save is not None:
        _save(whole, save)
        return ViewResult(path, save, len(content.charts))
    with tempfile.TemporaryDirectory(prefix="cosim-view-") as folder:
        recording = Path(folder, f"{path.name}.rrd")
        _save(whole, recording)
        _open(recording, quiet_environment(Path(folder, "settings")))
    return ViewResult(path, None, len(content.charts))


def quiet_environment(settings: Path) -> Mapping[str, str]:
    """Make an environment in which the viewer sends no usage figures, and ask it to confirm that.

    Only its settings switch them off, so it gets its own settings; a proxy without a server
    blocks any other request.

    Raises
    ------
    InputError : the viewer reports that it would send them.
    """
    settings.mkdir(parents=True, exist_ok=True)
    places = ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME")
    environment = dict(os.environ) | dict.fromkeys(places, str(settings))
    environment.pop("FORCE_RERUN_ANALYTICS", None)
    for name in _PROXIES:  # it would also look for newer versions of itself
        environment |= {name: _NOWHERE, name.lower(): _NOWHERE}
    _ask(environment, "disable")
    reported = _ask(environment, "config")
    if _OFF not in reported:
        raise InputError(
            "Rerun's usage figures could not be switched off",
            expected=_OFF,
            got=reported.strip()[:200],
            hint="rerun analytics disable; or `save`, and open the file yourself",
        )
    return environment


def _ask(environment: Mapping[str, str], what: str) -> str:
    try:
        done = subprocess.run(  # noqa: S603 - the viewer of the installed package
            [*_RERUN, "analytics", what],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError("the Rerun viewer cannot be started", got=str(error)) from error
    return done.stdout + done.stderr


def _open(recording: Path, environment: Mapping[str, str]) -> None:
    """Run the viewer, on a free port of the loopback interface only, until it is closed."""
    command = [*_RERUN, str(recording), "--bind", _LOOPBACK, "--port", "0"]
    done = subprocess.run(  # noqa: S603 - the same
        [*command, "--hide-welcome-screen"],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode:
        raise InputError(
            "the Rerun viewer ended with an error",
            got=done.stderr.strip().rpartition("\n")[2] or f"exit code {done.returncode}",
            hint="`save` FILE.rrd writes the recording without a viewer",
        )


def _pose(path: Path) -> dict[str, Reals]:
    craft = vehicle_of(Recording(Trace(path, incomplete=True)))
    if craft is None:
        return {}
    pose = {name: series.values for name, series in craft.pose.items()}
    return {"t": craft.pose["eta.x"].t, **pose}


def _check_display() -> None:
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise InputError(
            "there is no display to open a viewer on",
            expected="DISPLAY or WAYLAND_DISPLAY in the environment",
            got="neither",
            hint="`save` FILE.rrd writes the recording, to be opened elsewhere",
        )


def _save(recording: bytes, path: Path) -> None:
    with not_written("the recording", path, faults=(OSError, ValueError)):
        write_whole(path, recording)
