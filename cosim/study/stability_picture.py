"""The picture of a stability boundary: measured, exact and certified, in one plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import InputError, at_least, pyplot, save_picture
from cosim.study.consistency import certified_metric
from cosim.study.pictures import BLUE, DPI, GREEN, GREY, RED, edges, grid_of, numbers
from cosim.study.schema import StabilityPart, Study
from cosim.study.stability_boundary import Boundary, boundary

_LOST, _DARK = "#ec7a63", "#7a0f1a"
_STYLE = {"font.size": 9, "axes.axisbelow": True, "hatch.linewidth": 0.7}


def draw_stability(table: Any, manifest: dict[str, Any], target: Path) -> Path:
    """Draw stability over delay, or delay and loss, with the certified and the exact bounds.

    Raises
    ------
    InputError : the study has no [stability], or matplotlib is missing.
    """
    found = boundary(table, manifest)
    study = Study.model_validate(manifest["study"])
    part = study.stability
    if found is None or part is None:
        raise InputError(
            "this study does not define a picture",
            where=study.title,
            expected="[stability] in the study",
            hint="choose what to draw: `metric` and `over`",
        )
    frame, certified = table.to_pandas(), certified_metric(study)
    frame = frame.assign(
        _stable=numbers(frame[part.stable]),
        _figure=numbers(frame[part.gain]) if part.gain else np.nan,
        _kept=numbers(frame[certified]) if certified else np.nan,
    )
    plt = pyplot()
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(7.8, 4.8), layout="constrained")
        if part.loss is None:
            _over_delay(axis, frame, part, found)
        else:
            _over_delay_and_loss(figure, axis, frame, part, found)
        axis.set_xlabel(f"{part.delay}: delay of the whole loop [s]")
        axis.set_title(f"{study.title}\n{len(frame)} runs", fontsize=9, loc="left")
        save_picture(figure, target, DPI)
        plt.close(figure)
    return target


def _over_delay(axis: Any, frame: Any, part: StabilityPart, found: Boundary) -> None:
    drawn = "_figure" if part.gain else "_stable"
    edge = found.edges[0]
    for value, colour, marker, label in (
        (1.0, BLUE, "o", "measured: stable"),
        (0.0, RED, "X", "measured: not stable"),
    ):
        runs = frame[frame["_stable"] == value]
        axis.plot(runs[part.delay], runs[drawn], marker, ms=5, color=colour, label=label, zorder=3)
    axis.grid(alpha=0.25)
    if part.gain:
        axis.set_ylabel(part.gain)
        low, high = np.nanmin(frame["_figure"]), np.nanmax(frame["_figure"])
        if low < 0.0 < high:
            axis.axhline(0.0, color=GREY, lw=0.8)
    if edge.stable_to is not None and edge.unstable_from is not None:
        axis.axvspan(
            edge.stable_to,
            edge.unstable_from,
            color=RED,
            alpha=0.18,
            lw=0,
            label=f"measured boundary: {edge.stable_to:.4g} to {edge.unstable_from:.4g} s",
        )
    if found.certified_age is not None:
        axis.axvspan(
            min(0.0, float(frame[part.delay].min())),
            found.certified_age,
            color=GREEN,
            alpha=0.18,
            lw=0,
            label=f"certified: every age up to {at_least(found.certified_age, 4)} s",
        )
    if found.exact_margin is not None:
        axis.axvline(
            found.exact_margin,
            color="black",
            lw=1.4,
            ls="--",
            label=f"exact delay margin: {found.exact_margin:.4g} s",
        )
    axis.legend(loc="best", fontsize=8, framealpha=0.9)


def _over_delay_and_loss(
    figure: Any, axis: Any, frame: Any, part: StabilityPart, found: Boundary
) -> None:
    """Draw the delay on the x axis and one row of equal height per loss."""
    loss = part.loss or ""
    x, y, stable = grid_of(frame, part.delay, loss, "_stable")
    bx, by = edges(x), np.arange(y.size + 1) - 0.5
    if part.gain:
        settled = frame.assign(_figure=frame["_figure"].where(frame["_stable"] == 1.0))
        _, _, drawn = grid_of(settled, part.delay, loss, "_figure")
        stable_values = np.where(stable == 1.0, drawn, np.nan)
        mesh = axis.pcolormesh(bx, by, stable_values, cmap="YlGnBu")
        figure.colorbar(mesh, ax=axis, label=f"{part.gain}, mean of the runs", pad=0.02)
    unstable = np.where(stable < 1.0, 1.0 - stable, np.nan)
    axis.pcolormesh(bx, by, unstable, cmap="Reds", vmin=-0.5, vmax=2.2)
    for (row, column), value in np.ndenumerate(stable):
        if 0.0 < value < 1.0:
            text = f"{100 * (1 - value):.0f} %"
            axis.text(x[column], row, text, ha="center", va="center", fontsize=7)
    if (stable == 0.0).any():
        axis.fill([], [], color=_LOST, label="not stable (%: share of the runs)")
    _outline(axis, bx, by, stable >= 1.0, _DARK, "measured boundary: all runs stable to here", 2.4)
    if not frame["_kept"].isna().all():
        _, _, share = grid_of(frame, part.delay, loss, "_kept")
        for row, kept in enumerate(share >= 1.0):
            spans = [(bx[j], bx[j + 1] - bx[j]) for j in np.flatnonzero(kept)]
            plain = {"facecolor": "none", "edgecolor": GREEN, "hatch": "//", "lw": 0}
            axis.broken_barh(spans, (by[row], 1.0), **plain)
        label = "certified: every assumption of the guarantee met"
        _outline(axis, bx, by, share >= 1.0, GREEN, label, 2.6)
    _lines(axis, found)
    axis.set_yticks(range(y.size), [f"{value:g}" for value in y])
    axis.set_ylabel(f"{part.loss}: share of messages lost")
    axis.set(ylim=(by[0], by[-1]), xlim=(bx[0], bx[-1]))
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, fontsize=8, frameon=False)


def _lines(axis: Any, found: Boundary) -> None:
    for at, colour, style, label in (
        (found.certified_age, GREEN, ":", "age that the design allows"),
        (found.exact_margin, "black", "--", "exact delay margin, no loss"),
    ):
        if at is not None:
            axis.axvline(at, color=colour, lw=1.5, ls=style, label=f"{label}: {at:.4g} s")


def _outline(
    axis: Any, bx: Any, by: Any, inside: Any, colour: str, label: str, width: float
) -> None:
    """Draw the border of a set of cells."""
    for place, (px, py) in enumerate(outline(bx, by, inside)):
        style = {"color": colour, "lw": width, "solid_capstyle": "projecting", "zorder": 4}
        axis.plot(px, py, label=label if place == 0 else None, **style)


def outline(bx: Any, by: Any, inside: Any) -> list[tuple[list[float], list[float]]]:
    """Return the border of a set of cells, as pieces of two points: x and y of both.

    bx, by : borders of the columns, (nx + 1,), and rows, (ny + 1,); inside : (ny, nx).
    """
    pieces: list[tuple[list[float], list[float]]] = []
    # an edge lies between two cells of which one is inside
    for row, j in zip(*np.nonzero(inside[:, 1:] != inside[:, :-1]), strict=True):
        pieces.append(([bx[j + 1]] * 2, [by[row], by[row + 1]]))
    for i, column in zip(*np.nonzero(inside[1:] != inside[:-1]), strict=True):
        pieces.append(([bx[column], bx[column + 1]], [by[i + 1]] * 2))
    return pieces
