"""Pictures of a table of results: a curve with its confidence band, or a map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, pyplot, save_picture
from cosim.study.schema import Study
from cosim.study.summary import mean_of, share

BLUE, RED, GREEN, GREY = "#0b6e99", "#d1495b", "#5f7a3d", "#666666"
_COLOURS = (BLUE, RED, GREEN, "#8a5a9e", "#b8860b", "#4f6d7a")
STYLE = {"font.size": 9, "axes.grid": True, "grid.alpha": 0.25, "axes.axisbelow": True}
DPI = 130
_MOST_TICKS = 12


def draw(table: Any, manifest: dict[str, Any], target: Path, metric: str, over: list[str]) -> Path:
    """Draw one metric over one axis (a curve with its confidence band) or over two (a map).

    Parameters
    ----------
    target : PNG, SVG or PDF file.
    over : axes; ["delay", "per", "loss"] draws a curve over delay per value of loss.

    Raises
    ------
    InputError : no such metric or axis, no numbers in it, or matplotlib is missing.
    """
    study = Study.model_validate(manifest["study"])
    frame = table.to_pandas()
    if metric not in study.metrics:
        raise InputError.unknown("metric", metric, study.metrics, where="picture")
    per = over[2] if len(over) == 3 and over[1] == "per" else None
    axes = [over[0]] if per else over
    for name in (*axes, *([per] if per else [])):
        known = [axis.column for axis in study.vary]
        if name not in known:
            raise InputError.unknown("axis", name, known, where="picture")
    for name in axes:
        if not np.issubdtype(frame[name].dtype, np.number):
            raise InputError("an axis of a picture needs numbers", where=name)
    values = numbers(frame[metric])
    if np.isfinite(values).sum() == 0:
        raise InputError("there is nothing to draw", where=metric, got="no numbers")
    frame = frame.assign(_value=values)
    plt = pyplot()
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(7.2, 4.6), layout="constrained")
        truths = frame[metric].dtype == bool or _truths(frame[metric])
        if len(axes) == 1:
            _curve(axis, frame, axes[0], per, truths=truths)
            axis.set(xlabel=axes[0], ylabel=f"share of {metric}" if truths else metric)
        else:
            mesh = _map(axis, frame, axes[0], axes[1])
            figure.colorbar(mesh, ax=axis, label=f"share of {metric}" if truths else metric)
            axis.set(xlabel=axes[0], ylabel=axes[1])
        axis.set_title(f"{study.title}\n{len(frame)} runs", fontsize=9, loc="left")
        save_picture(figure, target, DPI)
        plt.close(figure)
    return target


def numbers(column: Any) -> NDArray[np.float64]:
    """Return a column as floats: true and false as 1 and 0, text and missing values as NaN."""
    return np.array(
        [float(v) if isinstance(v, (bool, int, float)) else np.nan for v in column.tolist()]
    )


def edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the borders of cells around increasing centres, (n,) -> (n + 1,)."""
    if centres.size == 1:
        half = 0.5 * abs(centres[0]) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middle = 0.5 * (centres[1:] + centres[:-1])
    first, last = centres[0] - (middle[0] - centres[0]), centres[-1] + (centres[-1] - middle[-1])
    return np.array([first, *middle, last])


def grid_of(frame: Any, x: str, y: str, column: str) -> tuple[Any, Any, NDArray[np.float64]]:
    """Return the mean of a column in every cell: centres (nx,), (ny,) and values (ny, nx)."""
    cells = frame.pivot_table(index=y, columns=x, values=column, aggfunc="mean", dropna=False)
    return (
        cells.columns.to_numpy(dtype=float),
        cells.index.to_numpy(dtype=float),
        cells.to_numpy(dtype=float),
    )


def _truths(column: Any) -> bool:
    return all(isinstance(v, bool) for v in column.tolist() if v is not None)


def _curve(axis: Any, frame: Any, x: str, per: str | None, *, truths: bool) -> None:
    parts: list[Any] = [(None, frame)] if per is None else list(frame.groupby(per, sort=True))
    for place, (value, part) in enumerate(parts):
        colour = _COLOURS[place % len(_COLOURS)]
        label = None if per is None else f"{per} = {value}"
        groups = list(part.groupby(x, sort=True))
        if len(groups) > 0.5 * len(part) and len(part) > 40:  # random values: nothing to average
            axis.plot(part[x], part["_value"], ".", ms=4, alpha=0.6, color=colour, label=label)
            continue
        points = []
        for key, runs in groups:
            values = runs["_value"].to_numpy()
            values = values[np.isfinite(values)]
            if values.size:
                points.append((float(key), *(_share(values) if truths else _mean(values))))
        at, middle, low, high = np.array(points).reshape(-1, 4).T
        axis.fill_between(at, low, high, color=colour, alpha=0.2, lw=0)
        axis.plot(at, middle, "o-", ms=3, lw=1.3, color=colour, label=label)
    if truths:
        axis.set_ylim(-0.03, 1.03)
    if per is not None:
        axis.legend(frameon=False)


def _share(values: Any) -> tuple[float, float, float]:
    found = share(int(values.sum()), values.size)
    return found.share, found.low or 0.0, 1.0 if found.high is None else found.high


def _mean(values: Any) -> tuple[float, float, float]:
    found = mean_of(values.tolist(), values.size)
    middle = found.mean or 0.0
    alone = found.low is None or found.high is None
    return (middle, middle, middle) if alone else (middle, found.low or 0.0, found.high or 0.0)


def _map(axis: Any, frame: Any, x: str, y: str) -> Any:
    sparse = frame.groupby([x, y]).ngroups > 0.5 * len(frame) and frame[x].nunique() > 40
    if sparse:
        return axis.scatter(frame[x], frame[y], c=frame["_value"], s=14, cmap="viridis")
    at_x, at_y, values = grid_of(frame, x, y, "_value")
    axis.grid(visible=False)
    for centres, set_ticks in ((at_x, axis.set_xticks), (at_y, axis.set_yticks)):
        if centres.size <= _MOST_TICKS:
            set_ticks(centres)
    return axis.pcolormesh(edges(at_x), edges(at_y), values, cmap="viridis")
