"""The report's pictures as SVG text; they need matplotlib (the extra `plot`)."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim.core import pyplot
from cosim.hinf.delay_lti import close, gain_at
from cosim.models import TABLE_1, paper_example as example
from cosim.paper.example import peak_of
from cosim.paper.figures import Curves
from cosim.paper.greatest_delays import Entry

BLUE, RED, GREEN, GREY = "#0b6e99", "#d1495b", "#5f7a3d", "#6b7280"
_STYLE = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.spines.top": False,
    "axes.spines.right": False,
    # the same drawing gives the same bytes
    "svg.hashsalt": "auv-cosim",
    "svg.fonttype": "path",
}


def _drawn(size: tuple[float, float], draw: Callable[[Any], None], panels: int = 1) -> str:
    plt = pyplot()
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(1, panels, figsize=size, layout="constrained")
        draw(axes)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
        plt.close(figure)
    return stream.getvalue()


def states(curves: Curves) -> str:
    """Draw what takes the place of Figure 2: the state."""

    def draw(axes: Any) -> None:
        f = curves.run
        for column, colour, name in ((0, BLUE, "$x_1$"), (1, RED, "$x_2$")):
            axes.plot(f.t, f.x[:, column], color=colour, lw=1.8, label=name)
        axes.plot(f.t, f.w, color=GREY, lw=0.9, ls=":", label="$w = \\sin t$")
        axes.set(xlabel="t [s]", ylabel="x(t)", xlim=(0, f.t[-1]))
        axes.legend(frameon=False)

    return _drawn((6.4, 3.4), draw)


def control(curves: Curves) -> str:
    """Draw what takes the place of Figure 3: the control."""

    def draw(axes: Any) -> None:
        f = curves.run
        axes.plot(f.t, f.u, color=BLUE, lw=1.8)
        axes.axhline(0, color=GREY, lw=0.8)
        axes.set(xlabel="t [s]", ylabel="u(t) = K x(t)", xlim=(0, f.t[-1]))

    return _drawn((6.4, 3.4), draw)


def frames() -> str:
    """Draw what takes the place of Figure 1: the frames and motions of four degrees of freedom."""

    def draw(panels: Any) -> None:
        for axes, side in zip(panels, (_from_above, _from_the_side), strict=True):
            side(axes)
            axes.set_aspect("equal")
            axes.axis("off")

    return _drawn((10.0, 4.4), draw, panels=2)


def _from_above(axes: Any) -> None:
    psi = np.radians(38.0)
    turn = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])

    def earth(points: Any) -> Any:
        # body (forward, right) to (north, east), drawn east to the right
        return np.array([4.2, 3.6]) + (np.asarray(points) @ turn.T)[:, ::-1]

    axes.fill(*earth(_hull()).T, facecolor="#dbeaf1", edgecolor=BLUE, lw=1.6)
    o, ahead, right = earth([(0, 0), (4.3, 0), (0, 2.8)])
    _arrow(axes, (0, 0), (0, 7.4), "x (north)", GREY, (0.15, -0.2))
    _arrow(axes, (0, 0), (8.2, 0), "y (east)", GREY, (-1.2, 0.3))
    axes.plot([o[0], o[0]], [o[1], o[1] + 3.6], color=GREY, lw=0.9, ls="--")
    arc = np.linspace(0, psi, 40)
    axes.plot(o[0] + 3.2 * np.sin(arc), o[1] + 3.2 * np.cos(arc), color=RED, lw=1.5)
    axes.text(o[0] - 0.15, o[1] + 3.2, "ψ, r (yaw)", color=RED, fontsize=12, ha="right")
    _arrow(axes, o, ahead, "u (surge)", BLUE, (0.15, 0.0))
    _arrow(axes, o, right, "v (sway)", BLUE, (0.15, -0.35))
    axes.set(xlim=(-0.6, 9.6), ylim=(-0.6, 8.0))


def _from_the_side(axes: Any) -> None:
    o = np.array([4.6, 3.2])
    waves = np.linspace(0, 9.4, 300)
    axes.plot(waves, 7.3 + 0.08 * np.sin(4 * waves), color=BLUE, lw=1.0, alpha=0.6)
    axes.fill(*(o + _hull()).T, facecolor="#dbeaf1", edgecolor=BLUE, lw=1.6)
    _arrow(axes, (0.4, 7.3), (0.4, 0.2), "z (down)", GREY, (0.15, 0.1))
    _arrow(axes, o, o + np.array([4.3, 0.0]), "u (surge)", BLUE, (-0.6, 0.3))
    _arrow(axes, o, o - np.array([0.0, 2.4]), "w (heave)", BLUE, (0.2, 0.0))
    length = TABLE_1["length"]
    ends = {"arrowstyle": "<->", "color": GREY, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    high = o[1] + 1.3
    axes.annotate("", (o[0] - length / 2, high), (o[0] + length / 2, high), arrowprops=ends)
    axes.text(o[0], high + 0.2, f"L = {length:g} m", color=GREY, ha="center")
    axes.set(xlim=(-0.2, 10.0), ylim=(-0.6, 8.0))


def _hull() -> Any:
    s, half = np.linspace(0, 2 * np.pi, 200), TABLE_1["length"] / 2
    across = np.sign(np.sin(s)) * np.abs(np.sin(s)) ** 0.7
    return np.column_stack([half * np.cos(s), 0.6 * across])


def _arrow(
    axes: Any, tail: Any, head: Any, text: str, colour: str, off: tuple[float, float]
) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=tuple(head), xytext=tuple(tail), arrowprops=style)
    axes.text(head[0] + off[0], head[1] + off[1], text, color=colour, fontsize=12)


def delays(table: Sequence[Entry]) -> str:
    """Draw Table 2, printed and computed."""

    def draw(axes: Any) -> None:
        floor = float(np.linalg.norm(example.D1))
        axes.axvspan(3.2, floor, color=RED, alpha=0.12, lw=0)
        axes.text(
            (3.2 + floor) / 2,
            6.0,
            "impossible: γ ≤ ‖D$_1$‖",
            ha="center",
            va="center",
            rotation=90,
            color=RED,
        )
        best = [e for e in table if e.searched is not None]
        axes.plot([e.gamma for e in table], [e.printed for e in table], "x", color=RED, ms=8, mew=2)
        axes.plot([e.gamma for e in best], [e.corrected for e in best], "o", color=BLUE, ms=6)
        axes.plot([e.gamma for e in best], [e.searched for e in best], "s", color=GREEN, ms=6)
        for e in best:
            if e.every_delay and e.searched is not None:
                axes.annotate(
                    "",
                    xy=(e.gamma, e.searched * 2.2),
                    xytext=(e.gamma, e.searched * 1.08),
                    arrowprops={"arrowstyle": "-|>", "color": GREEN},
                )
        last = best[-1]
        axes.text(21, last.printed * 0.82, "printed", color=RED, ha="right", va="top")
        axes.text(
            21,
            (last.corrected or 1) * 1.12,
            "corrected, printed $k_1$, $k_2$",
            color=BLUE,
            ha="right",
        )
        axes.text(
            21,
            (last.searched or 1) * 0.86,
            "$k_1$, $k_2$ searched, to the limit: no end",
            color=GREEN,
            ha="right",
            va="top",
        )
        axes.set(xlabel="γ", ylabel="delay d* [s]", yscale="log", xlim=(3.2, 21.5), ylim=(0.6, 60))
        axes.set_xticks([e.gamma for e in table], [f"{e.gamma:g}" for e in table])
        axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        axes.minorticks_off()

    return _drawn((6.4, 3.8), draw)


def gain_curve() -> str:
    """Draw |G(j omega)| of the printed gain and the claimed bound."""

    def draw(axes: Any) -> None:
        loop = close(example.system(), [example.PRINTED_K])
        peak = peak_of(loop)
        omega = np.geomspace(0.1, 1000, 1200)
        axes.semilogx(omega, gain_at(loop, omega), color=BLUE, lw=1.8)
        axes.axhline(example.GAMMA, color=RED, lw=1.2, ls="--")
        axes.text(0.11, example.GAMMA + 0.03, "claimed: γ = 5", color=RED)
        axes.plot(peak.frequency, peak.value, "o", color=BLUE)
        axes.annotate(
            f"{peak.value:.4f} at {peak.frequency:.1f} rad/s",
            (peak.frequency, peak.value),
            xytext=(-6, 10),
            textcoords="offset points",
            color=BLUE,
            ha="center",
        )
        axes.set(xlabel="ω [rad/s]", ylabel="largest gain from w to z", xlim=(0.1, 1000))
        axes.set_ylim(top=5.25)

    return _drawn((6.4, 3.4), draw)
