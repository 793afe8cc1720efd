"""Draw a flight from its trace: set-points, truth and estimate, ages, actuators, assumptions."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import pyplot, save_picture
from cosim.trace import Trace
from cosim.trace.outcome import assumptions_of, outcome_of

Reals = NDArray[np.float64]

_TRUTH, _ESTIMATE, _SET, _BAD = "#0b6e99", "#d1495b", "#555555", "#b3261e"
_COLOURS = ("#0b6e99", "#d1495b", "#5f7a3d", "#8a5a9e", "#b8860b", "#4f6d7a", "#a0522d", "#2e8b57")
_MOST_ROWS = 4
_WIDE = 72  # characters


@dataclass(frozen=True)
class PictureSubject:
    """What a picture shows beside the trace.

    Attributes
    ----------
    title, subtitle : of the picture.
    states, trim : outputs of the plant that are the states of the design, and their values there.
    positions : number of a state from 1, controlled and with a set-point.
    ages : greatest age designed for [s], by measurement.
    limits : bound by the name of a command.
    """

    title: str
    subtitle: str
    states: Sequence[str]
    trim: Sequence[float]
    positions: Sequence[int]
    ages: Mapping[str, float]
    limits: Mapping[str, float]


def draw_flight(trace: Path, subject: PictureSubject, target: Path) -> Path:
    """Draw a flight; PNG, SVG or PDF.

    Raises
    ------
    InputError : matplotlib is not installed, or the picture cannot be written.
    """
    plt = pyplot()
    rows = _Rows(trace)
    style = {
        "font.size": 9,
        "axes.titlesize": 10,
        "axes.grid": True,
        "grid.alpha": 0.25,
        "axes.axisbelow": True,
    }
    with plt.rc_context(style):
        figure = plt.figure(figsize=(14, 8.4), layout="constrained")
        figure.suptitle(f"{subject.title}\n", fontsize=13, fontweight="bold")
        figure.text(0.5, 0.955, subject.subtitle, ha="center", fontsize=9.5, color="#444444")
        left, middle, right = figure.add_gridspec(1, 3, width_ratios=(1.2, 1.05, 1.0))
        _states(figure, left, rows, subject)
        panels = middle.subgridspec(3, 1)
        _errors(figure.add_subplot(panels[0]), rows, subject)
        _ages(figure.add_subplot(panels[1]), rows, subject)
        _actuators(figure.add_subplot(panels[2]), rows, subject)
        lower = right.subgridspec(2, 1, height_ratios=(1, 1.5))
        _uses(figure.add_subplot(lower[0]), rows)
        _assumptions(figure.add_subplot(lower[1]), rows)
        save_picture(figure, target, 120)
        plt.close(figure)
    return target


class _Rows:
    """The rows of a trace that the picture needs."""

    def __init__(self, path: Path) -> None:
        trace = Trace(path)
        self.plant, self.out = trace.read("/plant/output"), trace.read("/controller/output")
        self.into = trace.read("/controller/input")
        self.outcome = outcome_of(trace.result)
        self.seconds = self.plant.log_time_ns / 1e9
        self.controlled = self.out.log_time_ns / 1e9

    def estimate(self, i: int) -> Reals:
        """Return the estimate of a deviation, by the number of the state from 1."""
        return np.asarray(self.out[f"estimate[{i}]"])

    def truth(self, name: str, trim: float) -> Reals:
        """Return a deviation of the plant from its trim, at the controller's points."""
        values: Reals = np.interp(self.controlled, self.seconds, self.plant[name]) - trim
        return values


def _states(figure: Any, place: Any, rows: _Rows, subject: PictureSubject) -> None:
    listed = list(subject.positions[:_MOST_ROWS]) or list(range(1, 1 + _MOST_ROWS))
    panels = place.subgridspec(len(listed), 1)
    received = rows.into.log_time_ns / 1e9
    above = None
    for k, i in enumerate(listed):
        axis = figure.add_subplot(panels[k], sharex=above)
        above = above or axis
        name, trim = subject.states[i - 1], subject.trim[i - 1]
        if f"reference[{i}]" in rows.into.columns:
            axis.step(
                *(received, rows.into[f"reference[{i}]"] + trim),
                where="post",
                color=_SET,
                ls="--",
                lw=1.0,
                label="set-point",
            )
        axis.plot(rows.seconds, rows.plant[name], color=_TRUTH, lw=1.5, label="vehicle")
        estimate = rows.estimate(i) + trim
        axis.plot(rows.controlled, estimate, color=_ESTIMATE, lw=0.7, label="its estimate")
        axis.set_ylabel(_label(name))
        if k == 0:
            axis.set_title("What the ship asks for, and what the vehicle does")
            axis.legend(loc="best", frameon=False)
        axis.tick_params(labelbottom=k == len(listed) - 1)
    axis.set_xlabel("time [s]")


def _errors(axis: Any, rows: _Rows, subject: PictureSubject) -> None:
    positions = [i for i, n in enumerate(subject.states, 1) if n.startswith(("eta.", "nu."))]
    for k, i in enumerate(p for p in positions if p in subject.positions):
        name = subject.states[i - 1]
        error = rows.estimate(i) - rows.truth(name, subject.trim[i - 1])
        axis.plot(rows.controlled, error, lw=0.8, color=_COLOURS[k % 8], label=_label(name))
    axis.set_title("Error of the estimate")
    axis.legend(loc="best", frameon=False, ncols=2, fontsize=8)
    axis.tick_params(labelbottom=False)


def _ages(axis: Any, rows: _Rows, subject: PictureSubject) -> None:
    for k, (name, most) in enumerate(subject.ages.items()):
        column = f"message_age.{name}"
        if column not in rows.out.columns:
            continue
        colour = _COLOURS[k % 8]
        axis.plot(rows.controlled, rows.out[column], lw=0.8, color=colour, label=name)
        axis.axhline(most, color=colour, ls=":", lw=1.2)
    axis.set_yscale("log")
    axis.set_title("Age in use [s] (dotted: certified up to)")
    axis.legend(loc="center right", frameon=False, ncols=2, fontsize=8)
    axis.tick_params(labelbottom=False)


def _actuators(axis: Any, rows: _Rows, subject: PictureSubject) -> None:
    for k, (name, limit) in enumerate(subject.limits.items()):
        share = np.asarray(rows.out[name]) / limit
        label = name.partition(".")[2] or name
        axis.step(rows.controlled, share, where="post", lw=0.8, color=_COLOURS[k % 8], label=label)
    for side in (-1, 1):
        axis.axhline(side, color=_SET, lw=1.0, ls=":")
    lines = -(-len(subject.limits) // 4)  # of the legend, above the lines
    axis.set(ylim=(-1.15, 1.2 + 0.25 * lines), xlabel="time [s]")
    axis.set_title("Commands, as shares of their limits")
    axis.legend(loc="upper right", frameon=False, ncols=4, fontsize=7)


def _uses(axis: Any, rows: _Rows) -> None:
    use = {} if rows.outcome is None else (rows.outcome.metrics.get("envelope_use") or {})
    names = list(use)[::-1]
    shares = [100 * min(float(use[name]), 2.0) for name in names]
    colours = [_BAD if share > 100 else _TRUTH for share in shares]
    axis.barh(
        [_label(name).partition(" [")[0] for name in names], shares, color=colours, height=0.6
    )
    axis.axvline(100, color=_SET, ls=":", lw=1.2)
    axis.set(xlim=(0, max([110.0, *shares])), title="Greatest use of the envelope [%]")
    axis.grid(axis="y", visible=False)


def _assumptions(axis: Any, rows: _Rows) -> None:
    axis.axis("off")
    checks = [] if rows.outcome is None else assumptions_of(rows.outcome)
    axis.set_title("Assumptions of the guarantee", loc="left")
    apart = min(0.105, 0.98 / max(1, len(checks)))
    for k, check in enumerate(checks):
        good = check.tone == "good"
        colour = "#2b7a3d" if good else _BAD
        y = 0.97 - k * apart
        axis.text(0.0, y, "\u2713" if good else "\u2717", color=colour, fontsize=11, va="top")
        axis.text(0.06, y, check.what, va="top", fontsize=8)
        why = textwrap.shorten(check.why, 2 * _WIDE, placeholder=" ...")
        lines = "\n".join(textwrap.wrap(why, _WIDE))
        axis.text(0.06, y - 0.36 * apart, lines, va="top", fontsize=6, color="#666666")


_WORDS = {
    "eta.x": "north x [m]",
    "eta.y": "east y [m]",
    "eta.z": "depth z [m]",
    "eta.phi": "roll [rad]",
    "eta.theta": "pitch [rad]",
    "eta.psi": "heading [rad]",
    "nu.u": "surge u [m/s]",
    "nu.v": "sway v [m/s]",
    "nu.w": "heave w [m/s]",
    "nu.p": "roll rate p [rad/s]",
    "nu.q": "pitch rate q [rad/s]",
    "nu.r": "yaw rate r [rad/s]",
}


def _label(name: str) -> str:
    return _WORDS.get(name, name)
