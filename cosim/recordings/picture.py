"""A picture of a recorded link: when it lost messages, how many in a row, and the delays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import pyplot, save_picture
from cosim.network import Recording
from cosim.recordings.statistics import LinkStatistics, delays_of, statistics_of

_BLUE, _RED = "#0b6e99", "#d1495b"
_WINDOW = 30
"""Messages over which the share of losses is taken in the picture."""


def draw_recordings(recordings: Mapping[str, Recording], target: Path) -> Path:
    """Draw each recording in a row: losses over time, lengths of runs, delays.

    Parameters
    ----------
    target : PNG, SVG or PDF file.

    Raises
    ------
    InputError : matplotlib is not installed, or the file cannot be written.
    """
    plt = pyplot()
    with plt.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        height = 2.6 * len(recordings)
        figure, axes = plt.subplots(
            len(recordings), 3, figsize=(12, height), layout="constrained", squeeze=False
        )
        for row, (name, each) in zip(axes, recordings.items(), strict=True):
            found = statistics_of(each)
            _draw_losses(row[0], each, name)
            _draw_runs(row[1], found)
            _draw_delays(row[2], each)
        save_picture(figure, target)
        plt.close(figure)
    return target


def _draw_losses(axes: Any, recording: Recording, name: str) -> None:
    times = (recording.sent_ns + recording.start_ns) / 1e9
    if recording.start_ns > 1e17:  # a clock that counts from 1970
        times = recording.sent_ns / 1e9
    window = min(_WINDOW, len(recording))
    share = np.convolve(recording.lost, np.full(window, 1 / window), mode="same")
    axes.plot(times, share, color=_RED, lw=0.9)
    axes.set(ylim=(-0.02, 1.02), xlabel="sent [s]", ylabel=f"loss, of {window} messages")
    axes.set_title(name or "link", loc="left")


def _draw_runs(axes: Any, found: LinkStatistics) -> None:
    for runs, colour, what in (
        (found.runs_of_losses, _RED, "lost"),
        (found.runs_of_arrivals, _BLUE, "arrived"),
    ):
        lengths = np.repeat(list(runs), list(runs.values())) if runs else np.zeros(0)
        if lengths.size:
            beyond = 1.0 - np.arange(lengths.size) / lengths.size
            axes.step(np.sort(lengths), beyond, where="pre", color=colour, lw=1.1, label=what)
            axes.set(xscale="log", yscale="log")
            axes.legend(frameon=False)
    axes.set(xlabel="messages in a row", ylabel="share of runs at least as long")


def _draw_delays(axes: Any, recording: Recording) -> None:
    delays = delays_of(recording)
    if delays.size:
        axes.hist(delays, bins=min(60, max(5, int(np.sqrt(delays.size)))), color=_BLUE)
    axes.set(xlabel="delay [s]", ylabel="messages")
