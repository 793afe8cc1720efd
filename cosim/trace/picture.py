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
_STYLE = {"font.size": 12, "axes.grid": True, "grid.alpha": 0.3}


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
    """Draw several runs of a vehicle in one picture: path, distance from it, measurement age.

    The distance is that of the estimate from the true position, of runs with an observer; of
    others that of the vehicle from its reference.

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
    with plt.rc_context(_STYLE):
        figure = plt.figure(figsize=(12, 6.4), layout="constrained")
        left, right = figure.add_gridspec(1, 2, width_ratios=(1, 1.15))
        path = figure.add_subplot(left)
        distance, age = (figure.add_subplot(each) for each in right.subgridspec(2, 1))
        # the first run is the main one: it is drawn last, on top
        for place, rows in reversed(list(enumerate(found))):
            style = {"color": _COLOURS[place], "lw": 2.0 if place == 0 else 1.2}
            _draw_path(path, rows, style)
            _draw_distance(distance, rows, style)
            _draw_age(age, rows, style)
        _label_axes(path, distance, age, found)
        save_picture(figure, target)
        plt.close(figure)
    return target


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

    def distance(self) -> NDArray[np.float64] | None:
        """Return the distance of the estimate, else of the reference, from the position [m]."""
        other = self.reference if self.estimated is None else self.estimated
        if other is None or len(other[0]) != self.controlled.size:
            return None
        true = (np.interp(self.controlled, self.seconds, self.plant[n]) for n in ("eta.x", "eta.y"))
        found: NDArray[np.float64] = np.hypot(
            *(each - own for each, own in zip(other, true, strict=True))
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


def _draw_path(axis: Any, rows: _RunRows, style: dict[str, Any]) -> None:
    north, east = rows.plant["eta.x"], rows.plant["eta.y"]
    if rows.reference is not None:
        axis.plot(rows.reference[1], rows.reference[0], "--", color="#555", lw=1.2)
    axis.plot(east, north, label=rows.label, **style)
    axis.plot(east[0], north[0], "o", color=style["color"], ms=7)
    axis.plot(east[-1], north[-1], "s", color=style["color"], ms=7)


def _draw_distance(axis: Any, rows: _RunRows, style: dict[str, Any]) -> None:
    distance = rows.distance()
    if distance is not None:
        axis.plot(rows.controlled, distance, **style)


def _draw_age(axis: Any, rows: _RunRows, style: dict[str, Any]) -> None:
    sawtooth, colour = rows.age(), style["color"]
    if sawtooth is not None:
        axis.plot(*sawtooth, color=colour, lw=0.8)
    if rows.limit is not None:
        axis.axhline(rows.limit, color=colour, lw=1.6, ls=":")
        words = f" {rows.label}: proved up to {rows.limit:.3g} s"
        axis.text(0, rows.limit, words, va="bottom", fontsize=11, color=colour)


def _label_axes(path: Any, distance: Any, age: Any, runs: Sequence[_RunRows]) -> None:
    path.set(xlabel="east y [m]", ylabel="north x [m]")
    path.set_title("Path (circle: start, square: end)", fontsize=12)
    path.set_aspect("equal", adjustable="datalim")
    path.legend(loc="best")
    observed = any(rows.estimated is not None for rows in runs)
    what = "estimated position" if observed else "position"
    distance.set(ylabel="distance [m]", ylim=(0, None))
    of = "the true one" if observed else "the reference"
    distance.set_title(f"Distance of the {what} from {of}", fontsize=12)
    distance.tick_params(labelbottom=False)
    age.set(xlabel="time [s]", ylabel="age [s]")
    age.set_title("Age of the measurement behind the command", fontsize=12)
    limits = [rows.limit for rows in runs if rows.limit is not None]
    if limits:
        age.set_ylim(0, max(limits) * 1.25)
