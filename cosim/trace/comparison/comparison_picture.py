"""Draw the signals that differ most between two traces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import pyplot, save_picture
from cosim.trace.comparison.compared_rows import SignalDiff
from cosim.trace.comparison.signals import Diff
from cosim.trace.reader import Trace
from cosim.trace.rows.hold import rows_in_force, sample_and_hold
from cosim.trace.tables.table import Series

MAX_SIGNALS = 6
_COLOURS = ("#0b6e99", "#d1495b")


def worst(found: Diff) -> list[SignalDiff]:
    """Choose at most `MAX_SIGNALS` to draw: the first to differ, then by relative difference.

    Outputs of components come before their copies on links and at receivers.
    """
    drawable = [signal for signal in found.parted if signal.max_abs is not None]
    first, rest = drawable[:1], drawable[1:]
    rest.sort(key=lambda s: (not s.topic.endswith("/output"), -(s.max_rel or 0.0)))
    return [*first, *rest][:MAX_SIGNALS]


def draw_diff(found: Diff, target: Path) -> Path | None:
    """Draw both traces over each other for the `worst` signals; None, no file, if none differs.

    Raises
    ------
    InputError : matplotlib is not installed, or the file cannot be written.
    """
    signals = worst(found)
    if not signals:
        return None
    plt = pyplot()
    traces = [Trace(path) for path in found.paths]
    with plt.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure, axes = plt.subplots(
            len(signals),
            2,
            figsize=(12, 1.2 + 1.9 * len(signals)),
            layout="constrained",
            squeeze=False,
            sharex=True,
            width_ratios=(1.6, 1),
        )
        for signal, (both, apart) in zip(signals, axes, strict=True):
            _draw(signal, [trace.signal(signal.name) for trace in traces], both, apart)
        labels = [Path(path).stem for path in found.paths]
        if labels[0] == labels[1]:
            labels = list(found.paths)
        axes[0][0].legend(axes[0][0].get_lines()[:2], labels, loc="best")
        axes[0][0].set_title("both (dotted: first difference)")
        axes[0][1].set_title("second minus first")
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        try:
            return save_picture(figure, target)
        finally:
            plt.close(figure)


def _draw(signal: SignalDiff, series: list[Series], both: Any, apart: Any) -> None:
    a, b = series
    for one, colour, width in ((a, _COLOURS[0], 1.4), (b, _COLOURS[1], 0.9)):
        both.step(one.delivered, one.values, where="post", color=colour, lw=width)
    unit = f" [{signal.unit}]" if signal.unit else ""
    both.set_ylabel(f"{signal.name.rpartition(':')[2]}{unit}")
    if signal.first_s is not None:
        both.axvline(signal.first_s, color="#333", lw=0.8, ls=":")
    instants, difference = _difference(a, b)
    apart.step(instants, difference, where="post", color="#444", lw=0.8)


def _difference(a: Series, b: Series) -> tuple[Any, Any]:
    instants = np.union1d(a.delivered_ns, b.delivered_ns)
    values = []
    for one in (a, b):
        value, there = sample_and_hold(one.values, rows_in_force(one.delivered_ns, instants))
        values.append(np.where(there, value.astype(np.float64), np.nan))
    return instants / 1e9, values[1] - values[0]
