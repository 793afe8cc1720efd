"""Curves of recorded signals, with matplotlib (the extra `plot`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cosim.core import InputError, axes_or_new, drawing

if TYPE_CHECKING:
    from numpy.typing import NDArray

_GRID = {"alpha": 0.3}


def draw_series(
    t: NDArray[Any],
    values: NDArray[Any],
    labels: Sequence[str],
    ylabel: str,
    *,
    stepwise: bool,
    ax: Any = None,
) -> Any:
    """Draw one signal, or the columns of a group, over time [s]; return the axes.

    stepwise : each value holds until the next.

    Raises
    ------
    InputError : texts, or matplotlib is not installed.
    """
    if values.dtype.kind not in "fiub":
        raise InputError("texts cannot be drawn as a curve", where=ylabel)
    ax = axes_or_new(ax)
    style = {"drawstyle": "steps-post"} if stepwise else {}
    columns = values.reshape(values.shape[0], -1).T
    for column, label in zip(columns, labels, strict=True):
        ax.plot(t, column, lw=1.4, label=label, **style)
    ax.set(xlabel="time [s]", ylabel=ylabel)
    ax.grid(**_GRID)
    if len(columns) > 1:
        ax.legend(frameon=False)
    return ax


def draw_rows(series: Sequence[Any]) -> Any:
    """Draw each series in axes of its own over one time axis; return the axes."""
    axes = drawing().subplots(
        len(series),
        1,
        sharex=True,
        squeeze=False,
        layout="constrained",
        figsize=(8.0, 1.2 + 1.8 * len(series)),
    )[1][:, 0]
    for one, ax in zip(series, axes, strict=True):
        one.plot(ax)
        ax.label_outer()
    return axes
