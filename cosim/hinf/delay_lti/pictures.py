"""Pictures of responses and roots, with matplotlib (the extra `plot`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.core import axes_or_new, drawing
from cosim.hinf.delay_lti.roots import Roots

_GRID = {"alpha": 0.3}
_GREY = "#6b7280"
_RED = "#d1495b"
_SEEN = 0.1  # share of the greatest magnitude down to which the phase is shown
_FARTHEST = 4.0  # of a Nyquist curve that is shown, where it goes to infinity


def draw_time(response: Any, ax: Any = None) -> Any:
    """Draw a `TimeResponse`; return the axes."""
    ax = axes_or_new(ax)
    y = response.outputs
    if y.ndim == 1:
        lines = [(y, "")]
    elif y.ndim == 2:
        lines = [(row, f"output {i + 1}") for i, row in enumerate(y)]
    else:
        lines = [
            (y[i, j], f"input {j + 1} to output {i + 1}")
            for j in range(y.shape[1])
            for i in range(y.shape[0])
        ]
    for values, label in lines:
        ax.plot(response.time, values, lw=1.6, label=label)
    for t, _ in response.impulses:
        ax.axvline(t, color=_GREY, ls=":", lw=1.0)
    ax.set(xlabel="time [s]", ylabel="output", title=f"{response.kind} response")
    ax.set_xlim(response.time[0], response.time[-1])
    ax.grid(**_GRID)
    if len(lines) > 1:
        ax.legend(frameon=False)
    return ax


def draw_bode(response: Any, ax: Any = None) -> Any:
    """Draw magnitude and phase of a `FrequencyResponse`; return both axes."""
    if ax is None:
        ax = drawing().subplots(2, 1, sharex=True, layout="constrained")[1]
    upper, lower = ax
    p, m, _ = response.response.shape
    phase = np.degrees(np.unwrap(np.angle(response.response), axis=-1))
    for i in range(p):
        for j in range(m):
            label = f"input {j + 1} to output {i + 1}"
            size = np.maximum(np.abs(response.response[i, j]), 1e-300)
            upper.semilogx(response.omega, 20.0 * np.log10(size), lw=1.6, label=label)
            lower.semilogx(response.omega, phase[i, j], lw=1.6)
    upper.set(ylabel="magnitude [dB]", title="frequency response")
    lower.set(xlabel="frequency [rad/s]", ylabel="phase [deg]")
    if p * m > 1:
        upper.legend(frameon=False)
    _mark_margins(response, upper, lower, phase[0, 0])
    _lowest_phase(response, lower, phase)
    for axes in (upper, lower):
        axes.set_xlim(response.omega[0], response.omega[-1])
        axes.grid(which="both", **_GRID)
    return ax


def _mark_margins(response: Any, upper: Any, lower: Any, phase: Any) -> None:
    margins = response.margins
    if margins is None:
        return
    upper.axhline(0.0, color=_GREY, lw=0.8)
    if math.isfinite(margins.gain):
        decibel = 20.0 * math.log10(margins.gain)
        upper.plot([margins.gain_frequency] * 2, [-decibel, 0.0], color=_RED, lw=2.0)
    if math.isfinite(margins.phase):
        w = margins.phase_frequency
        at = float(np.interp(w, response.omega, phase))
        limit = 180.0 * (2 * round((at / 180.0 - 1) / 2) + 1)
        lower.plot([w, w], [at, limit], color=_RED, lw=2.0)
        lower.axhline(limit, color=_GREY, lw=0.8)
    upper.set_title(str(margins), fontsize="medium")


def _lowest_phase(response: Any, lower: Any, phase: Any) -> None:
    """Cut off the phase where a delay has turned it through many circles and little is left."""
    size = np.abs(response.response).max(axis=(0, 1))
    seen = phase[..., size > _SEEN * size.max()]
    if seen.size and float(phase.min()) < float(seen.min()) - 360.0:
        lower.set_ylim(float(seen.min()) - 180.0, float(seen.max()) + 45.0)


def draw_nyquist(response: Any, ax: Any = None) -> Any:
    """Draw the curve of a `Nyquist`, its mirror image and -1; return the axes."""
    ax = axes_or_new(ax)
    x, y = response.response.real, response.response.imag
    (line,) = ax.plot(x, y, lw=1.5)
    ax.plot(x, -y, lw=1.0, ls="--", color=line.get_color())
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=_GREY, lw=0.6, ls=":")
    ax.plot([-1.0], [0.0], "+", color=_RED, ms=11, mew=2)
    far = float(np.abs(response.response).max())
    limit = far * 1.1 if far <= 2.0 * _FARTHEST else _FARTHEST
    limit = max(limit, 1.2)
    ax.set_xlim(-limit, limit)
    ax.set_ylim(-limit, limit)
    ax.set_aspect("equal")
    ax.set(xlabel="real part", ylabel="imaginary part")
    verdict = "stable" if response.stable else f"{response.closed_roots} unstable roots"
    turns = f"{response.encirclements} clockwise encirclements of -1"
    ax.set_title(f"{turns}, {response.open_poles} unstable poles: {verdict}", fontsize="medium")
    ax.grid(**_GRID)
    return ax


def draw_roots(roots: Roots, ax: Any = None) -> Any:
    """Draw characteristic roots; return the axes."""
    ax = axes_or_new(ax)
    ax.axvline(0.0, color=_GREY, lw=0.8)
    ax.axhline(0.0, color=_GREY, lw=0.8)
    right = roots.real >= 0.0
    ax.plot(roots.real[~right], roots.imag[~right], "x", ms=8, mew=1.8)
    ax.plot(roots.real[right], roots.imag[right], "x", ms=8, mew=1.8, color=_RED)
    title = f"{roots.size} rightmost characteristic roots"
    ax.set(xlabel="real part [1/s]", ylabel="imaginary part [rad/s]", title=title)
    ax.grid(**_GRID)
    return ax
