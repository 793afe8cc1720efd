"""The report's pictures as SVG text; they need matplotlib (the extra `plot`)."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim.hinf import close
from cosim.hinf.norm import gain_at
from cosim.models import paper_example as example
from cosim.models.auv import TABLE_1
from cosim.paper.example import peak_of
from cosim.paper.figures import Curves
from cosim.paper.table_2 import Entry
from cosim.trace.picture import pyplot

BLUE, RED, GREEN, GREY = "#0b6e99", "#d1495b", "#5f7a3d", "#6b7280"
_STYLE = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.spines.top": False,
    "axes.spines.right": False,
    # the same drawing, the same bytes
    "svg.hashsalt": "auv-cosim",
    "svg.fonttype": "path",
}


def _drawn(size: tuple[float, float], draw: Callable[[Any], None]) -> str:
    plt = pyplot()
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(figsize=size, layout="constrained")
        draw(axes)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
        plt.close(figure)
    return stream.getvalue()


def states(curves: Curves) -> str:
    """Figure 2."""

    def draw(axes: Any) -> None:
        f = curves.flight
        for column, colour, name in ((0, BLUE, "$x_1$"), (1, RED, "$x_2$")):
            axes.plot(f.t, f.x[:, column], color=colour, lw=1.8, label=name)
        axes.plot(f.t, f.w, color=GREY, lw=0.9, ls=":", label="$w = \\sin t$")
        axes.set(xlabel="t [s]", ylabel="x(t)", xlim=(0, f.t[-1]))
        axes.legend(frameon=False)

    return _drawn((6.4, 3.4), draw)


def control(curves: Curves) -> str:
    """Figure 3."""

    def draw(axes: Any) -> None:
        f = curves.flight
        axes.plot(f.t, f.u, color=BLUE, lw=1.8)
        axes.axhline(0, color=GREY, lw=0.8)
        axes.set(xlabel="t [s]", ylabel="u(t) = K x(t)", xlim=(0, f.t[-1]))

    return _drawn((6.4, 3.4), draw)


def frames() -> str:
    """Figure 1: the frames and motions of the four degrees of freedom, from above."""

    def draw(axes: Any) -> None:
        psi, half = np.radians(32.0), TABLE_1["length"] / 2
        turn = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
        centre = np.array([3.4, 4.4])  # east, north

        def earth(points: Any) -> Any:
            # body (forward, right) to (north, east), drawn east to the right
            return centre + (np.asarray(points) @ turn.T)[:, ::-1]

        s = np.linspace(0, 2 * np.pi, 200)
        hull = np.column_stack(
            [half * np.cos(s), 0.55 * np.sign(np.sin(s)) * abs(np.sin(s)) ** 0.8]
        )
        axes.fill(*earth(hull).T, facecolor="#dbeaf1", edgecolor=BLUE, lw=1.6)

        def arrow(tail: Any, head: Any, text: str, colour: str, off: tuple[float, float]) -> None:
            style = {"arrowstyle": "-|>", "color": colour, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=head, xytext=tail, arrowprops=style)
            axes.text(head[0] + off[0], head[1] + off[1], text, color=colour, fontsize=12)

        o, ahead, right = earth([(0, 0), (4.0, 0), (0, 2.4)])
        arrow(o, ahead, "u (surge)", BLUE, (0.1, 0.05))
        arrow(o, right, "v (sway)", BLUE, (0.1, -0.25))
        arrow((0, 0), (0, 7.6), "x (north)", GREY, (0.12, -0.1))
        arrow((0, 0), (7.0, 0), "y (east)", GREY, (-0.5, 0.2))
        axes.plot([o[0], o[0]], [o[1], o[1] + 2.9], color=GREY, lw=0.9, ls="--")
        arc = np.linspace(0, psi, 40)
        axes.plot(o[0] + 2.3 * np.sin(arc), o[1] + 2.3 * np.cos(arc), color=RED, lw=1.5)
        axes.text(o[0] + 0.75, o[1] + 2.35, "ψ, r (yaw)", color=RED, fontsize=12, ha="left")
        axes.plot([0, o[0]], [0, o[1]], color=GREY, lw=0.9, ls=":")
        for where, text, colour in (((0, 0), "z (down)", GREY), (o, "w (heave)", BLUE)):
            axes.plot(*where, "o", ms=11, mfc="white", mec=colour, mew=1.6, zorder=5)
            axes.plot(*where, "x", ms=6, color=colour, mew=1.6, zorder=6)
            axes.text(where[0] - 0.2, where[1] - 0.62, text, color=colour, fontsize=11, ha="center")
        axes.set(xlim=(-1.0, 8.2), ylim=(-0.9, 8.2), aspect="equal")
        axes.axis("off")

    return _drawn((5.2, 4.9), draw)


def delays(table: Sequence[Entry]) -> str:
    """Table 2: what is printed and what comes out."""

    def draw(axes: Any) -> None:
        floor = float(np.linalg.norm(example.D1))
        axes.axvspan(3.5, floor, color=RED, alpha=0.12, lw=0)
        axes.text((3.5 + floor) / 2, 4.0, "impossible\nγ ≤ ‖D1‖", ha="center", color=RED)
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
            21, (last.corrected or 1) * 1.12, "corrected, printed k1, k2", color=BLUE, ha="right"
        )
        axes.text(
            21,
            (last.searched or 1) * 0.86,
            "k1, k2 searched, to the limit: no end",
            color=GREEN,
            ha="right",
            va="top",
        )
        axes.set(xlabel="γ", ylabel="delay d* [s]", yscale="log", xlim=(3.5, 21.5), ylim=(0.6, 60))
        axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        axes.minorticks_off()

    return _drawn((6.4, 3.8), draw)


def gain_curve() -> str:
    """|G(j omega)| of the printed gain against the claim."""

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
