"""Draw pictures of runs from their traces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, pyplot, save_picture
from cosim.trace.reader import Trace
from cosim.trace.tables.table import Table
from cosim.trace.tables.traffic import loop_age

_COLOURS = ("#0b6e99", "#d1495b", "#5f7a3d", "#8a5a9e")
_FORCES = ("force.x", "force.y", "force.z", "moment.z")
_ROWS = 4


@dataclass(frozen=True)
class LabelledTrace:
    """A trace and its label in a picture.

    Attributes
    ----------
    age_limit_s : age of measurements designed for [s], drawn as a line.
    states : outputs of the plant that are the states of an observer; none without one.
    """

    label: str
    path: Path
    age_limit_s: float | None = None
    states: Sequence[str] = ()


def compare_runs(runs: Sequence[LabelledTrace], target: Path) -> Path:
    """Draw several runs of a vehicle in one picture: path, states, commands, measurement age.

    Of runs with an observer also the error of its estimate of the position.

    Parameters
    ----------
    runs : at most four traces of scenarios with the components `plant` and `controller`.
    target : PNG, SVG or PDF file.

    Raises
    ------
    InputError : matplotlib is not installed, or a trace is not of such a scenario.
    """
    plt = pyplot()
    found = [_RunRows(run) for run in runs]
    observed = any(rows.estimated is not None for rows in found)
    with plt.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = plt.figure(figsize=(13, 8.2), layout="constrained")
        left, middle, right = figure.add_gridspec(1, 3, width_ratios=(1.15, 1, 1))
        heights = (2.2, 1, 1) if observed else (3, 1)
        own = [
            figure.add_subplot(g) for g in left.subgridspec(len(heights), 1, height_ratios=heights)
        ]
        panels = _Panels(
            path=own[0],
            error=own[1] if observed else None,
            age=own[-1],
            states=[figure.add_subplot(g) for g in middle.subgridspec(_ROWS, 1)],
            commands=[figure.add_subplot(g) for g in right.subgridspec(len(found[0].commands), 1)],
        )
        # the first run is the main one: it is drawn last, on top
        for place, rows in reversed(list(enumerate(found))):
            style = {"color": _COLOURS[place], "lw": 1.4 if place == 0 else 0.8}
            _draw(rows, style, panels)
        _label_axes(panels, found)
        save_picture(figure, target)
        plt.close(figure)
    return target


@dataclass(frozen=True)
class _Panels:
    """The axes of a picture; `error` where there is an observer."""

    path: Any
    error: Any | None
    age: Any
    states: list[Any]
    commands: list[Any]


class _RunRows:
    """The rows of one trace that a picture needs."""

    def __init__(self, run: LabelledTrace) -> None:
        trace = Trace(run.path)
        self.label, self.limit = run.label, run.age_limit_s
        for topic in ("/plant/output", "/controller/output"):
            if topic not in trace.topics:
                raise InputError(
                    "this trace is not of a run of a vehicle",
                    where=str(run.path),
                    expected="components called plant and controller",
                    got=", ".join(trace.topics) or "no topics",
                )
        self.plant = trace.read("/plant/output")
        self.command = trace.read("/controller/output")
        self.received = trace.read("/plant/input")
        into = trace.read("/controller/input") if "/controller/input" in trace.topics else None
        self.links = [trace.delivered(link) for link in trace.link_names]
        self.seconds = self.plant.log_time_ns / 1e9
        self.controlled = self.command.log_time_ns / 1e9
        self.step_ns = int((trace.run or {}).get("step_ns", 0))
        numbers = {name: i for i, name in enumerate(run.states, 1)}
        places = [numbers.get(name) for name in ("eta.x", "eta.y")]
        references = (
            [f"reference[{i}]" for i in places] if run.states else ["reference.x", "reference.y"]
        )
        self.reference = _columns(into, references)
        self.estimated = _columns(self.command, [f"estimate[{i}]" for i in places])
        driven = [n for n in self.received.columns if n.startswith(("thruster.", "fin."))]
        forces = _FORCES[0] in self.received.columns
        self.commands = list(_FORCES) if forces else driven[:_ROWS]

    def age(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return times and age [s] of the measurement behind the command.

        Of a controller with an observer the oldest measurement in use, as it says; otherwise by
        `loop_age`, None without a link each way.
        """
        own = [self.command[n] for n in self.command.columns if n.startswith("message_age.")]
        if own:
            return self.controlled, np.max(own, axis=0)
        up, down = self._link_from("plant."), self._link_from("controller.")
        if up is None or down is None:
            return None
        t, age = loop_age(up, down, self.plant.log_time_ns, self.step_ns)
        return t / 1e9, age

    def error(self) -> NDArray[np.float64] | None:
        """Return the distance of the estimated position from the true one [m]."""
        if self.estimated is None:
            return None
        true = (np.interp(self.controlled, self.seconds, self.plant[n]) for n in ("eta.x", "eta.y"))
        found: NDArray[np.float64] = np.hypot(
            *(own - other for own, other in zip(self.estimated, true, strict=True))
        )
        return found

    def _link_from(self, component: str) -> Table | None:
        from_it = (t for t in self.links if any(n.startswith(component) for n in t.columns))
        return next(from_it, None)


def _columns(table: Table | None, names: Sequence[str]) -> list[NDArray[np.float64]] | None:
    """Return the columns with these names; None where one is missing."""
    if table is None or not all(name in table.columns for name in names):
        return None
    return [np.asarray(table[name], dtype=np.float64) for name in names]


def _draw(f: _RunRows, style: dict[str, Any], panels: _Panels) -> None:
    path = panels.path
    path.plot(f.plant["eta.y"], f.plant["eta.x"], label=f.label, **style)
    path.plot(f.plant["eta.y"][0], f.plant["eta.x"][0], "o", color=style["color"], ms=5)
    if f.reference is not None:
        path.plot(f.reference[1], f.reference[0], "--", color="#555", lw=0.8)
    for axis, name in zip(panels.states, ("eta.x", "eta.y", "eta.z", "eta.psi"), strict=True):
        axis.plot(f.seconds, f.plant[name], **style)
    for axis, name in zip(panels.commands, f.commands, strict=False):
        axis.step(f.received.log_time_ns / 1e9, f.received[name] / 1e3, where="post", **style)
    error = f.error()
    if error is not None and panels.error is not None:
        panels.error.plot(f.controlled, error, **style)
    sawtooth = f.age()
    if sawtooth is not None:
        panels.age.plot(*sawtooth, color=style["color"], lw=0.5)
    if f.limit is not None:
        colour = style["color"]
        panels.age.axhline(f.limit, color=colour, lw=1.2, ls=":")
        panels.age.text(
            0, f.limit, f" {f.label}: designed for", va="bottom", fontsize=8, color=colour
        )


def _label_axes(panels: _Panels, runs: Sequence[_RunRows]) -> None:
    path, age, error = panels.path, panels.age, panels.error
    title = "Path (dots: start, dashed: reference)"
    path.set(xlabel="east y [m]", ylabel="north x [m]", title=title)
    path.plot(0, 0, "k+", ms=12, mew=1.5)
    path.set_aspect("equal", adjustable="datalim")
    path.legend(loc="best")
    pose = ("north x [m]", "east y [m]", "depth z [m]", "heading ψ [rad]")
    for axis, label in zip(panels.states, pose, strict=True):
        axis.set_ylabel(label)
    for axis, name in zip(panels.commands, runs[0].commands, strict=True):
        axis.set_ylabel(_COMMANDS.get(name, f"{name.partition('.')[2]} [kN]"))
    panels.states[0].set_title("Position and heading")
    panels.commands[0].set_title("Thrust as the vehicle receives it")
    for axis in (*panels.states[:-1], *panels.commands[:-1]):
        axis.tick_params(labelbottom=False)
    for axis in (panels.states[-1], panels.commands[-1], age):
        axis.set_xlabel("time [s]")
    age.set(ylabel="age [s]", title="Age of the measurement behind the command")
    limits = [f.limit for f in runs if f.limit is not None]
    if limits:
        age.set_ylim(0, max(limits) * 1.25)
    if error is not None:
        error.set(ylabel="error [m]", title="Error of the estimated position", ylim=(0, None))
        error.tick_params(labelbottom=False)


_COMMANDS = {
    **dict(zip(_FORCES, ("surge [kN]", "sway [kN]", "heave [kN]", "yaw [kN m]"), strict=True)),
    "thruster.yaw": "yaw [kN m]",
}
