"""Draw pictures of runs from their traces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, optional, written_beside
from cosim.trace.reader import Trace
from cosim.trace.tables.table import Table
from cosim.trace.tables.traffic import deliveries, link_names, loop_age

_COLOURS = ("#0b6e99", "#d1495b", "#5f7a3d", "#8a5a9e")
_FORCES = ("force.x", "force.y", "force.z", "moment.z")


@dataclass(frozen=True)
class LabelledTrace:
    """A trace and its label in a picture."""

    label: str
    path: Path


def compare_runs(
    runs: Sequence[LabelledTrace], target: Path, *, age_limit_s: float | None = None
) -> Path:
    """Draw several runs of the vehicle in one picture: path, states, thrust, measurement age.

    Parameters
    ----------
    runs : at most four traces of `AuvPlant` and `HinfController` scenarios.
    target : PNG, SVG or PDF file.
    age_limit_s : age of measurements designed for [s], drawn as a line.

    Raises
    ------
    InputError : matplotlib is not installed, or a trace is not of such a scenario.
    """
    plt = pyplot()
    with plt.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = plt.figure(figsize=(13, 8.2), layout="constrained")
        grid = figure.add_gridspec(4, 3, width_ratios=(1.15, 1, 1))
        path = figure.add_subplot(grid[:3, 0])
        age = figure.add_subplot(grid[3, 0])
        states = [figure.add_subplot(grid[i, 1]) for i in range(4)]
        thrust = [figure.add_subplot(grid[i, 2]) for i in range(4)]
        # the first run is the main one: it is drawn last, on top
        for place, run in reversed(list(enumerate(runs))):
            style = {"color": _COLOURS[place], "lw": 1.4 if place == 0 else 0.8}
            _draw(_RunRows(run), style, path, states, thrust, age)
        _label_axes(path, states, thrust, age, age_limit_s)
        save_picture(figure, target)
        plt.close(figure)
    return target


def pyplot() -> Any:
    """Import matplotlib's pyplot for use without a display; `InputError` if not installed."""
    needed = {"extra": "plot", "what": "pictures need matplotlib"}
    optional("matplotlib", **needed).use("Agg")
    return optional("matplotlib.pyplot", **needed)


def save_picture(figure: Any, target: Path, dpi: int = 110) -> Path:
    """Write a figure to a file, and the folders it needs.

    Raises
    ------
    InputError : it cannot be written, or its format is not known.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with written_beside(target) as partial:
            figure.savefig(partial, dpi=dpi, format=target.suffix[1:] or None)
    except (OSError, ValueError) as error:  # ValueError: no such format
        raise InputError(
            "the picture cannot be written",
            where=str(target),
            expected="a .png, .svg or .pdf file in a folder that can be written",
            got=str(error)[:200],
        ) from error
    return target


class _RunRows:
    """The rows of one trace that a picture needs."""

    def __init__(self, run: LabelledTrace) -> None:
        trace = Trace(run.path)
        self.label = run.label
        for topic in ("/plant/output", "/controller/output"):
            if topic not in trace.topics:
                raise InputError(
                    "this trace is not of a run of the vehicle",
                    where=str(run.path),
                    expected="components called plant and controller",
                    got=", ".join(trace.topics) or "no topics",
                )
        self.plant = trace.read("/plant/output")
        self.command = trace.read("/controller/output")
        self.received = trace.read("/plant/input")
        self.reference = (
            trace.read("/controller/input") if "/controller/input" in trace.topics else None
        )
        self.links = [deliveries(trace, link) for link in link_names(trace)]
        self.seconds = self.plant.log_time_ns / 1e9
        self.step_ns = int((trace.run or {}).get("step_ns", 0))

    def age(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return times and age [s] of the measurement behind the command, by `loop_age`.

        None without a link each way.
        """
        up, down = self._link_from("plant."), self._link_from("controller.")
        if up is None or down is None:
            return None
        t, age = loop_age(up, down, self.plant.log_time_ns, self.step_ns)
        return t / 1e9, age

    def _link_from(self, component: str) -> Table | None:
        from_it = (t for t in self.links if any(n.startswith(component) for n in t.columns))
        return next(from_it, None)


def _draw(
    f: _RunRows, style: dict[str, Any], path: Any, states: Any, thrust: Any, age: Any
) -> None:
    path.plot(f.plant["eta.y"], f.plant["eta.x"], label=f.label, **style)
    path.plot(f.plant["eta.y"][0], f.plant["eta.x"][0], "o", color=style["color"], ms=5)
    if f.reference is not None and "reference.x" in f.reference.columns:
        path.plot(
            f.reference["reference.y"], f.reference["reference.x"], "--", color="#555", lw=0.8
        )
    for axis, name in zip(states, ("eta.x", "eta.y", "eta.z", "eta.psi"), strict=True):
        axis.plot(f.seconds, f.plant[name], **style)
    for axis, name in zip(thrust, _FORCES, strict=True):
        axis.step(f.received.log_time_ns / 1e9, f.received[name] / 1e3, where="post", **style)
    sawtooth = f.age()
    if sawtooth is not None:
        age.plot(*sawtooth, color=style["color"], lw=0.5)


def _label_axes(path: Any, states: Any, thrust: Any, age: Any, age_limit_s: float | None) -> None:
    title = "Path (dots: start, dashed: reference)"
    path.set(xlabel="east y [m]", ylabel="north x [m]", title=title)
    path.plot(0, 0, "k+", ms=12, mew=1.5)
    path.set_aspect("equal", adjustable="datalim")
    path.legend(loc="best")
    pose = ("north x [m]", "east y [m]", "depth z [m]", "heading ψ [rad]")
    forces = ("surge [kN]", "sway [kN]", "heave [kN]", "yaw [kN m]")
    for axis, label in zip((*states, *thrust), (*pose, *forces), strict=True):
        axis.set_ylabel(label)
    states[0].set_title("Position and heading")
    thrust[0].set_title("Thrust as the vehicle receives it")
    for axis in (*states[:3], *thrust[:3]):
        axis.tick_params(labelbottom=False)
    for axis in (states[3], thrust[3], age):
        axis.set_xlabel("time [s]")
    age.set(ylabel="age [s]", title="Age of the measurement behind the command")
    if age_limit_s is not None:
        age.axhline(age_limit_s, color="#333", lw=1, ls=":")
        age.text(0, age_limit_s, " designed for", va="bottom", fontsize=8)
        age.set_ylim(0, age_limit_s * 1.2)
