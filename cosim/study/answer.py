"""What a study says of what was asked: where each condition was met, in a sentence per metric."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cosim.study.columns import Column, Integers, Reals, StudyColumns
from cosim.study.summary import mean_of, share

_MOST_SENTENCES = 3
_MOST_RANGES = 3


def answers_of(columns: StudyColumns, confidence: float = 0.95) -> list[str]:
    """Return a sentence for each condition that the study asks for, else for its first numbers.

    Over a grid they count design points, whose values were chosen: an interval would have no
    meaning. Without a grid all runs are of one distribution, and have one interval.
    """
    metrics = [m for m in columns.metrics.values() if m.known.any()]
    asked = [m for m in metrics if columns.study.metrics[m.name].asks]
    truths = asked + [m for m in metrics if m.kind == "truth" and m not in asked]
    numbers = [m for m in metrics if m.kind == "number"]
    cells = point_of(columns)
    if cells is None:
        found = [_met_by_all(columns, m, confidence) for m in truths]
        found = found or [_mean_of_all(columns, m, confidence) for m in numbers]
    else:
        found = [_met_at_points(columns, m, cells) for m in truths]
        found = found or [_means_at_points(columns, m, cells) for m in numbers]
    return found[:_MOST_SENTENCES]


def pooling_words(columns: StudyColumns) -> str:
    """Return over which runs shares and means are taken."""
    cells, runs = point_of(columns), columns.runs.size
    if cells is None:
        if columns.draws is None or runs < 2:
            return "Nothing is drawn at random: the figures describe these runs, and no others."
        return f"Pooled over {runs} runs: all are draws from one distribution."
    count = int(cells.max()) + 1
    if columns.draws is None:
        return f"{count} points, one run each: nothing is drawn at random, so nothing is pooled."
    each = np.bincount(cells)
    per = f"{each.min()}" if each.min() == each.max() else f"{each.min()} to {each.max()}"
    return (
        f"{count} points with {per} draws each. Intervals are per point: the points were chosen, "
        "and nothing is pooled over them."
    )


def point_of(columns: StudyColumns) -> Integers | None:
    """Return the number of the design point of each run, (n,); None without a grid."""
    grid = columns.grid
    if not grid:
        return None
    values = np.column_stack([axis.values for axis in grid])
    _, found = np.unique(values, axis=0, return_inverse=True)
    return found.reshape(-1).astype(np.int64)


def _met_by_all(columns: StudyColumns, metric: Column, confidence: float) -> str:
    met = int(metric.values[metric.known].sum())
    of = int(metric.known.sum())
    found = share(met, of, confidence)
    words = f"{metric.name}: met by {met} of {of} runs, {100 * found.share:.1f} %"
    if columns.draws is None or found.low is None or found.high is None:
        return words
    ends = f"interval {100 * found.low:.1f} to {100 * found.high:.1f} %"
    return f"{words}, {100 * confidence:g} % {ends}"


def _mean_of_all(columns: StudyColumns, metric: Column, confidence: float) -> str:
    found = mean_of(metric.values[metric.known].tolist(), metric.values.size, confidence)
    ends = ""
    drawn = columns.draws is not None
    if drawn and found.low is not None and found.high is not None and found.low < found.high:
        ends = f", {100 * confidence:g} % interval {found.low:.4g} to {found.high:.4g}"
    return f"{metric.name}: mean {found.mean:.4g} of {found.count} runs{ends}"


def _met_at_points(columns: StudyColumns, metric: Column, cells: Integers) -> str:
    number = np.bincount(cells, metric.known)
    met = np.bincount(cells, np.where(metric.known, metric.values, 0.0))
    known = number > 0
    fate = np.where(met == number, 2, np.where(met == 0, 0, 1))
    words = {2: "in all runs", 1: "in some", 0: "in none"}
    if number.max() <= 1:
        words = {2: "yes", 1: "", 0: "no"}
    parts: list[str] = []
    for kind, word in words.items():
        chosen = known & (fate == kind)
        if count := int(chosen.sum()):
            of = "" if parts else f" of {known.size} points"
            parts.append(f"{word} at {count}{of}{_where(columns, cells, chosen)}")
    if without := int((~known).sum()):
        parts.append(f"no value at {without}")
    return f"{metric.name}: {', '.join(parts)}"


def _means_at_points(columns: StudyColumns, metric: Column, cells: Integers) -> str:
    number = np.bincount(cells, metric.known)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.bincount(cells, np.where(metric.known, metric.values, 0.0)) / number
    least, most = int(np.nanargmin(means)), int(np.nanargmax(means))
    ends = (f"{means[k]:.4g} at {_place(columns, cells, k)}" for k in (least, most))
    what = "" if number.max() <= 1 else "mean "
    return f"{metric.name}: {what}{' to '.join(ends)}"


def _place(columns: StudyColumns, cells: Integers, point: int) -> str:
    run = int(np.argmax(cells == point))
    return ", ".join(f"{axis.name} {axis.text(float(axis.values[run]))}" for axis in columns.grid)


def _where(columns: StudyColumns, cells: Integers, chosen: Reals) -> str:
    """Return the ranges of the only axis of a grid in which points are; "" if there are many."""
    if len(columns.grid) != 1 or columns.grid[0].kind != "number":
        return ""
    (axis,) = columns.grid
    values = np.array([axis.values[np.argmax(cells == k)] for k in range(chosen.size)])
    ranges = list(_ranges(values, np.flatnonzero(chosen).tolist()))
    if len(ranges) > _MOST_RANGES:
        return ""
    words = (f"{a:.4g}" if a == b else f"{a:.4g} to {b:.4g}" for a, b in ranges)
    return f" ({axis.name} {' and '.join(words)})"


def _ranges(values: Reals, places: Sequence[int]) -> Iterator[tuple[float, float]]:
    """Yield the first and last value of each run of neighbours."""
    first = last = places[0]
    for place in places[1:]:
        if place != last + 1:
            yield float(values[first]), float(values[last])
            first = place
        last = place
    yield float(values[first]), float(values[last])
