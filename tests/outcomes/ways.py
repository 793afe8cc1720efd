"""Every way in which a run can end, each a real run, and what its views must say of it."""

from __future__ import annotations

import pickle
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from cli.shell import cosim
from hostile.hostile_fmu import hostile_fmu, misbehaviour
from report_pages import report_of
from shared import fmu_store, made_once

from cosim.core import CosimError
from cosim.trace import Trace

TITLE = "A <b>run</b> & its </script> end"
_PUMP = """
title = "{title}"
[run]
end = {end}
step = 0.1
[components.pump]
fmu = "pump.fmu"
parameters = {{ u = 1.0, {parameters} }}
"""
_PROMISES = """
[[assertions]]
eventually = "pump.x > 0.15"
[[assertions]]
name = "the <i>tank</i> stays empty"
always = "pump.x < 0.25"
[[assertions]]
always = "pump.x >= 0"
"""
"""x is the time: one promise is kept, one broken at 0.3 s, one kept to the end."""
_STOP = """
[[events]]
at = "0.5 s"
stop = "enough"
[[assertions]]
eventually = "pump.x > 0.9"
"""
_WEAK = """
extends = "thruster-saturation"
title = "Weak thrusters, for ten seconds"
assertions = []
[run]
end = 10.0
"""
_OUTAGE = """
extends = "link-outage"
title = "The link is gone, for two seconds"
assertions = []
[run]
end = 8.0
[[events]]
at = "2 s"
for = "2 s"
outage = ["uplink", "downlink"]
"""
_NAIVE = """
extends = "auv-acoustic-naive"
title = "A gain for a link without delay, for forty seconds"
[run]
end = 40.0
"""
_FAR = """
extends = "auv-direct"
title = "A position beyond all numbers"
[run]
end = 4.0
[[events]]
at = "1 s"
override = { "plant.eta.z" = 1e300, "plant.eta.psi" = 1e200 }
"""


class Event(NamedTuple):
    """A line of `/log` that must be there: the instant [s], level, name, and what it begins with.

    count : how many there are that begin so.
    """

    time_s: float
    level: str
    name: str
    words: str
    count: int = 1


@dataclass(frozen=True)
class Way:
    """A way to end.

    Attributes
    ----------
    scenario : its text.
    code : the exit code of `cosim run`.
    headline : what every view must say; `tone` : how it must look.
    events : lines of `/log`.
    reason : what stands in the reason.
    sent : the signal that the command gets in the middle of the run.
    """

    scenario: str
    code: int
    headline: str
    tone: str
    events: tuple[Event, ...] = ()
    reason: str = ""
    sent: signal.Signals | None = None


def _pump(fault: str = "nothing", call: str = "step", more: str = "", end: float = 1.0) -> str:
    found = misbehaviour(fault, call, 0.4 if call == "step" else 0.0)
    parameters = ", ".join(f"{name} = {value}" for name, value in found.items())
    return _PUMP.format(title=TITLE, end=end, parameters=parameters) + more


_FAILS = Event(0.3, "error", "the <i>tank</i> stays empty", "assertion failed")
WAYS = {
    "finished": Way(_pump(), 0, "finished", "good"),
    "assertion": Way(
        _pump(more=_PROMISES), 1, "finished, 1 of 3 assertions failed", "bad", (_FAILS,)
    ),
    "warned": Way(
        _pump("warning"),
        *(0, "finished", "good"),
        (Event(0.4, "warning", "pump", "the <pump> is hot", count=6),),
    ),
    "diverged": Way(_pump("grow", end=9.0), 0, "diverged", "bad", reason="pump.x"),
    "not-finite": Way(_pump("not-a-number"), 4, "failed", "bad", reason="pump.x is nan"),
    "refused": Way(
        _pump("error", more=_PROMISES),
        *(4, "failed, 2 of 3 assertions failed", "bad"),
        (_FAILS, Event(0.4, "error", "always pump.x >= 0", "assertion failed")),
        reason="step from t = 0.4 s returned fmi2Error",
    ),
    "crashed": Way(_pump("segfault"), 4, "failed", "bad", reason="SIGSEGV"),
    "component-killed": Way(_pump("kill"), 4, "failed", "bad", reason="SIGKILL"),
    "exited": Way(_pump("exit-3"), 4, "failed", "bad", reason="exit"),
    "not-started": Way(_pump("error", "enter"), 4, "failed", "bad", reason="pump"),
    "crashed-at-end": Way(_pump("abort", "free"), 4, "failed", "bad", reason="after the run"),
    "stopped": Way(
        _pump(more=_STOP),
        *(0, "stopped", "open"),
        (
            Event(0.5, "info", "scenario", "stopped at t = 0.5 s"),
            Event(0.5, "info", "eventually pump.x > 0.9", "assertion undecided"),
        ),
        reason="enough",
    ),
    "asked-to-end": Way(_pump("end"), 0, "stopped", "open", reason="asked for the end"),
    "interrupted": Way(_pump(end=2000.0), 130, "stopped", "open", sent=signal.SIGINT),
    "killed": Way(_pump(end=2000.0), -signal.SIGKILL, "cut short", "bad", sent=signal.SIGKILL),
    "saturated": Way(
        _WEAK,
        *(0, "finished, 2 of 11 assumptions not met", "open"),
        (
            Event(0.05, "warning", "controller.force.x", "at its limit of 400 N"),
            Event(4.4, "info", "controller.force.x", "below its limit again"),
            Event(5.3, "warning", "plant.nu.u", "outside the envelope of the proof"),
            Event(6.15, "info", "plant.nu.u", "inside the envelope again"),
        ),
    ),
    "outage": Way(
        _OUTAGE,
        *(0, "finished, 1 of 11 assumptions not met", "open"),
        (
            Event(2.0, "warning", "uplink", "outage begun"),
            Event(4.0, "info", "downlink", "outage ended"),
            Event(2.65, "warning", "controller", "the measurement in use is older"),
        ),
    ),
    "far": Way(
        _FAR,
        *(0, "finished, 4 of 11 assumptions not met", "open"),
        (
            Event(1.0, "info", "scenario", "event 1 (at 1 s): override plant.eta.z 1e+300"),
            Event(1.0, "warning", "plant.eta.psi", "outside the envelope"),
            Event(1.05, "warning", "controller.moment.z", "at its limit"),
        ),
    ),
    "limit-cycle": Way(_NAIVE, 0, "limit cycle", "bad", reason="the limits, not the feedback"),
}


LEVELS = ("unknown", "debug", "info", "warning", "error", "fatal")
"""By their numbers in `foxglove.Log`."""


class Line(NamedTuple):
    """A line of `/log`."""

    time_s: float
    level: str
    name: str
    message: str


@dataclass(frozen=True)
class Found:
    """What the views say of a run.

    Attributes
    ----------
    code : of `cosim run`; `summary` : what it printed; `trace` : the file that it left.
    badge, tone, why : of the report.
    info : `cosim trace info`; `state` : its line of this name.
    log : the lines of `/log`.
    """

    code: int
    summary: str
    trace: Path
    badge: str
    tone: str
    why: str
    info: str
    state: str
    log: tuple[Line, ...]

    @property
    def headline(self) -> str:
        """How the run ended, by its summary, or by the message of an interrupted one; else ""."""
        answer, following, _ = self.summary.partition("\nnext:")
        if following:
            return re.split(r":\s|;\s", answer)[1].replace("\n", " ")
        for line in self.summary.splitlines():
            if line.strip().startswith("got: stopped"):
                return line.strip().removeprefix("got: ").partition(": ")[0]
        return ""

    def to_json(self) -> dict[str, Any]:
        """The row of the table."""
        return {
            "exit_code": self.code,
            "summary": self.headline,
            "report": self.badge,
            "info": self.state,
            "log": [f"{x.time_s:g} s {x.level} {x.name}: {x.message}" for x in self.log],
        }


def seen(name: str, folder: Path) -> Found:
    """Run it in a folder, and look at it in every view."""
    way = WAYS[name]
    asked = f"{name}.toml"
    (folder / asked).write_text(way.scenario)
    if "pump.fmu" in way.scenario:
        hostile_fmu(folder, "2.0", "pump")
    words: tuple[str, ...] = ("run", asked, "--out", f"{name}.mcap")
    if "pump.fmu" not in way.scenario:
        words += ("--flavour", "native", "--fmus", str(fmu_store("native")))
    if way.sent is None:
        done = cosim(*words, cwd=folder)
        code, summary = done.code, done.out
    else:
        code, summary = _signalled(words, way.sent, folder)
    path = folder / f"{name}.mcap"
    path = path if path.exists() else path.with_name(f"{path.name}.partial")
    page = report_of(path, folder)
    info = cosim("trace", "info", path, cwd=folder).out
    state = next(line for line in info.splitlines() if line.startswith("state "))
    return Found(
        code=code,
        summary=summary,
        trace=path,
        badge=page.status,
        tone=page.tone,
        why=page.why,
        info=info,
        state=state.removeprefix("state ").strip(),
        log=tuple(log_of(path)),
    )


@cache
def found(name: str) -> Found:
    """What the views say of a run that ended so; made once per session, and only read."""

    def run(folder: Path) -> None:
        (folder / "found.pickle").write_bytes(pickle.dumps(seen(name, folder)))

    folder = made_once(f"outcomes/{name}", run)
    views: Found = pickle.loads((folder / "found.pickle").read_bytes())  # noqa: S301 - ours
    return views


def log_of(path: Path) -> Iterator[Line]:
    """The lines of `/log`."""
    rows = Trace(path, incomplete=True).read("/log")
    for i in range(len(rows)):
        at, level = int(rows.log_time_ns[i]) / 1e9, LEVELS[int(rows["level"][i])]
        yield Line(at, level, str(rows["name"][i]), str(rows["message"][i]))


def departures(name: str, found: Found) -> list[str]:
    """What is not the same story as `WAYS` has it."""
    way, wrong = WAYS[name], []
    whole = found.trace.suffix == ".mcap"
    headlines = {"report": found.badge, "info": found.state}
    if found.summary.strip():
        headlines["summary"] = found.headline
    if whole:
        headlines["/log"] = _concluding(found.log)
    for view, text in headlines.items():
        if text != way.headline:
            wrong.append(f"{view}: {text!r}, not {way.headline!r}")
    if found.code != way.code:
        wrong.append(f"exit code {found.code}, not {way.code}")
    if found.tone != way.tone:
        wrong.append(f"the report is {found.tone}, not {way.tone}")
    if way.reason not in found.why:
        wrong.append(f"the report gives {found.why!r}, not {way.reason!r}")
    wrong += [f"/log: not {event}" for event in way.events if not _is_there(event, found.log)]
    if any(a.time_s > b.time_s for a, b in zip(found.log, found.log[1:], strict=False)):
        wrong.append("/log is not in order of time")
    return wrong


def _is_there(event: Event, log: tuple[Line, ...]) -> bool:
    there = [
        line
        for line in log
        if (line.level, line.name) == (event.level, event.name)
        and line.message.startswith(event.words)
    ]
    return len(there) == event.count and abs(there[0].time_s - event.time_s) < 1e-9


def _concluding(log: tuple[Line, ...]) -> str:
    """How the run ended, by its log."""
    headlines = [line.message.partition(": ")[0] for line in log if line.name == "run"]
    return headlines[0] if headlines else ""


def _signalled(words: tuple[str, ...], number: signal.Signals, folder: Path) -> tuple[int, str]:
    """Send a signal to a run in the middle of it; return its exit code and what it printed."""
    line = [sys.executable, "-m", "cosim", *words, "--pace", "1"]
    with subprocess.Popen(  # noqa: S603 - ourselves
        line, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while process.poll() is None and not _has_rows(folder / f"{words[3]}.partial"):
            time.sleep(0.2)
        process.send_signal(number)
        out, err = process.communicate()
    return process.returncode, out + err


def _has_rows(path: Path) -> bool:
    with suppress(CosimError):
        topics = Trace(path, incomplete=True).topics
        return "/pump/output" in topics and topics["/pump/output"].count > 0
    return False
