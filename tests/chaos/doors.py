"""The doors: every command, and the session in Python, that runs FMUs or writes what lasts."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from chaos.command import cosim_line, run_quietly
from hostile.hostile_fmu import hostile_fmu

STEP_S = 0.05
_END_S, _SHORT_S = 3000.0, 20.0
_COMPONENTS = """
[components.h]
fmu = "{worse}"
isolate = {isolate}
parameters = {{ decay = 0.7, x0 = 0.3 }}
[components.s]
fmu = "{other}"
parameters = {{ decay = 0.3, x0 = 0.1 }}
[[connections]]
from = "h.x"
to = "s.u"
[[connections]]
from = "s.x"
to = "h.u"
"""
_SESSION = """
import sys
from cosim import CosimError, open_session
try:
    with open_session("scenario.toml") as session:
        while not session.ended:
            session.run(session.time + 50.0)
            session.bias("s.x", 0.001)
    print("done")
except KeyboardInterrupt:
    sys.exit(130)
except CosimError as error:
    print(error.text())
    sys.exit(error.exit_code)
"""
_STUDY = """
title = "u at rest"
scenario = "scenario.toml"
traces = "all"
[[vary]]
kind = "grid"
name = "x0"
path = "components.s.parameters.x0"
values = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
[metrics]
x = "final.s.x"
"""


class Fault(NamedTuple):
    """A fault of the FMU: which, in which call, at what time, of which version of FMI."""

    fault: str = "nothing"
    call: str = "step"
    at: float = 0.0
    version: str = "2.0"


class Door(NamedTuple):
    """A way into this project.

    Attributes
    ----------
    line : its command, by the stock and the folder in which it is called.
    runs_fmus : whether a fault of an FMU meets it.
    usual : its exit code.
    takes : how long it takes, beside a run.
    """

    line: Callable[[Path], list[str]]
    runs_fmus: bool = False
    usual: int = 0
    takes: float = 1.0


_LIMITS = ("--limit", "call=3", "--limit", "start=3", "--limit", "end=3")
"""An FMU may hang in any call, in those that end it as well."""
_RUN = ("run", "scenario.toml", "--out", "out.mcap", *_LIMITS)
_STUDY_RUN = ("study", "run", "study.toml", "--out", "study", *_LIMITS, "--workers")
DOORS: Mapping[str, Door] = MappingProxyType(
    {
        "run": Door(lambda _: cosim_line(*_RUN), runs_fmus=True),
        "run, isolated": Door(lambda _: cosim_line(*_RUN), runs_fmus=True),
        "run, in process": Door(lambda _: cosim_line(*_RUN, "--no-supervise")),
        "study": Door(lambda _: cosim_line(*_STUDY_RUN, "1"), runs_fmus=True, takes=1.5),
        "study, workers": Door(lambda _: cosim_line(*_STUDY_RUN, "2"), runs_fmus=True, takes=3.0),
        "session": Door(lambda _: [sys.executable, "session.py"]),
        "check": Door(
            lambda stock: cosim_line("fmu", "check", stock / "h.fmu", "--run", "--time", "3"),
            takes=0.6,
        ),
        "rerun": Door(
            lambda stock: cosim_line(
                *("trace", "rerun", stock / "trace.mcap", "--out", "out.mcap", "--fmus", stock)
            )
        ),
        "inject": Door(
            lambda stock: cosim_line(
                *("trace", "inject", stock / "trace.mcap", "--into", stock / "s.fmu"),
                *("--as-component", "s", "--out", "out.mcap"),
            )
        ),
        "recover": Door(
            lambda stock: cosim_line(
                *("trace", "recover", stock / "cut.mcap.partial", "--out", "out.mcap")
            ),
            usual=3,
            takes=0.7,
        ),
        "export": Door(
            lambda stock: cosim_line(
                *("trace", "export", stock / "trace.mcap", "--wide", "--out", "out.csv")
            )
        ),
        "report": Door(
            lambda stock: cosim_line(
                *("trace", "report", stock / "trace.mcap", "--out", "out.html")
            )
        ),
        "certificate": Door(
            lambda _: cosim_line("design", "paper", "--save", "out.json"), takes=1.3
        ),
    }
)


def end_of(door: str) -> float:
    """The end of the runs of a door, in simulated seconds."""
    return _SHORT_S if door.startswith("study") else _END_S


def lay_out(name: str, stock: Path, folder: Path, fault: Fault | None = None) -> list[str]:
    """Write what the door reads into its folder; return its line."""
    worse = stock / "h.fmu"
    if fault is not None:
        about = {"fault": fault.fault, "call": fault.call, "at": fault.at}
        worse = hostile_fmu(folder, fault.version, "worse", **about)
    isolate = str(name == "run, isolated").lower()
    parts = _COMPONENTS.format(worse=worse, other=stock / "s.fmu", isolate=isolate)
    text = f'title = "Two in a loop"\n[run]\nend = {end_of(name)}\nstep = {STEP_S}\n{parts}'
    (folder / "scenario.toml").write_text(text)
    (folder / "study.toml").write_text(_STUDY)
    (folder / "session.py").write_text(_SESSION)
    return DOORS[name].line(stock)


def make_stock(folder: Path) -> float:
    """Make what the doors read: FMUs, trace.mcap, cut.mcap.partial; return the time of a run."""
    for name, version in (("h", "2.0"), ("s", "3.0")):
        hostile_fmu(folder, version, name)
    lay_out("run", folder, folder)
    began = time.monotonic()
    run_quietly("run", "scenario.toml", "--out", "trace.mcap", folder=folder)
    seconds = time.monotonic() - began
    content = (folder / "trace.mcap").read_bytes()
    (folder / "cut.mcap.partial").write_bytes(content[: len(content) * 4 // 5])
    return seconds
